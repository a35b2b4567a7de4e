"""The core's buses signal by signal, with cocotb: the test bench, and what is tried on it."""
