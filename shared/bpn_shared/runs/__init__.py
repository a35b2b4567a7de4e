"""Runs: how one comes to be, what it leaves on disk and how that is written and read, and what several came to."""
