"""The whole system on one machine: supervisor, command line, benchmarks."""
