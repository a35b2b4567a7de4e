"""What is made of the core's RTL: bitstreams, IP for Vivado, estimates, and reports of them."""
