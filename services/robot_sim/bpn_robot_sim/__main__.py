from bpn_robot_sim.worker import main

raise SystemExit(main())
