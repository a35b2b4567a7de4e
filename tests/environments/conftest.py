"""Not part of `make test`: packages of others are needed, which `make test-environments` installs."""

import os

collect_ignore_glob = [] if "BPN_ENVIRONMENTS" in os.environ else ["test_*.py"]
