"""What is made of the core's RTL outside a simulation: bitstreams, IP for Vivado, estimates, and reports of them."""
