"""One module for each `bpn` command: `add_options(parser)` declares its options, `run(options)` does it."""
