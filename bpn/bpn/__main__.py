from bpn.cli import main

raise SystemExit(main())
