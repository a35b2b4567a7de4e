"""`python -m bpn_dashboard`."""

import sys

from bpn_dashboard.service import main

sys.exit(main())
