from bpn_learner.service import main

raise SystemExit(main())
