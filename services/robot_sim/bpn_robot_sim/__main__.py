from bpn_robot_sim.service import main

raise SystemExit(main())
