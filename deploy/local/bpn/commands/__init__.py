"""One module for each `bpn` command: `add(subparsers)` declares its options, `run(options)` does it."""
