"""Not part of `make test`: cross compilers and an emulator are needed, which `make test-cross` installs."""

import os

collect_ignore_glob = [] if "BPN_CROSS" in os.environ else ["test_*.py"]
