"""What somebody should hear of at once: told to open pages, and to an address that the operator gave."""
