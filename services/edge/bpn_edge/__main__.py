from bpn_edge.service import main

raise SystemExit(main())
