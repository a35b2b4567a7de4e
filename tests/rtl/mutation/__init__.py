"""How many random faults in the core's RTL the tests notice."""
