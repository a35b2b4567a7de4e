"""Runs: the registry with its leases, REST, live view and web UI. The run folders are the truth."""
