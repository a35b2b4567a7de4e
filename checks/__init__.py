"""`make check-claims`: what the pages say against what was measured, and every link against what is there."""
