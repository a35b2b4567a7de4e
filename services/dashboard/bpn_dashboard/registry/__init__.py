"""Which runs there are, which are wanted, and who works on them."""
