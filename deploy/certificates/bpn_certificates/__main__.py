from bpn_certificates.command import main

raise SystemExit(main())
