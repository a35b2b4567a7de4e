"""A plug-in of pytest: the C++ kernels as `make test-sanitized` has built them, in place of the installed ones."""

import importlib.util
import os
import sys
from pathlib import Path

KERNELS = {"edge": "bpn_edge.kernel._native", "learner": "bpn_learner._native"}

for _service, _name in KERNELS.items():
    (_file,) = Path(os.environ["BPN_SANITIZED"], _service).glob("_native*.so")
    _spec = importlib.util.spec_from_file_location(_name, _file)
    assert _spec is not None
    assert _spec.loader is not None
    sys.modules[_name] = importlib.util.module_from_spec(_spec)
    _spec.loader.exec_module(sys.modules[_name])
