"""The policy in an FPGA: what a build of the core can run, weight sets, the driver, and where the core is."""
