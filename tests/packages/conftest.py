"""Not part of `make test`: wheels are needed, which `make test-dist` builds."""

import os

collect_ignore_glob = [] if "BPN_PYTHONS" in os.environ else ["test_*.py"]
