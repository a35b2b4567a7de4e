"""The core's tests in short on other sources: `python -m tests.rtl.short_suite RTL`; exit status 3: no model."""

import os
import sys
import tempfile
from pathlib import Path

import pytest

from bpn_edge.fpga import verilated
from bpn_edge.fpga.build import Build
from bpn_shared.spec.config import ConfigError


def main() -> int:
    rtl = Path(sys.argv[1])
    with tempfile.TemporaryDirectory() as cache:
        os.environ[verilated.CACHE] = cache
        verilated.sources.folder = lambda: rtl  # what the tests' models are made of
        try:
            verilated.model_library(Build())
        except ConfigError:
            return 3
        here = Path(__file__).parent
        tests = [
            str(here / name) for name in ("test_refusals.py", "test_swaps.py", "test_exact.py")
        ]
        chosen = "not other_builds and not trained"
        return int(
            pytest.main(
                ["-q", "-x", "-p", "no:cacheprovider", "--timeout=300", "-k", chosen, *tests]
            )
            != 0
        )


if __name__ == "__main__":
    sys.exit(main())
