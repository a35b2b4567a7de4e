"""The core's buses signal by signal: cocotb's main program around the core, one process for each scenario.

Of `make test-rtl`, since cocotb needs Python as a shared library: `pytest tests/rtl/protocol/buses.py`.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

import cocotb_tools.config
import find_libpython
import pytest

from bpn_edge.fpga.build import Build
from bpn_edge.fpga.verilated import Harness, model_library

HERE = Path(__file__).parent
LIBRARIES = cocotb_tools.config.libs_dir
COCOTB = Harness(
    "bpn_core",
    str(cocotb_tools.config.share_dir / "lib/verilator/verilator.cpp"),
    options=("--vpi", "--public-flat-rw"),
    flags=("-O1", "-fvisibility=default", "-UVL_TIME_CONTEXT", f"-I{HERE}"),
    runtime=("verilated_vpi.cpp",),
    link=(f"-L{LIBRARIES}", f"-Wl,-rpath,{LIBRARIES}", "-lcocotbvpi_verilator"),
)
SCENARIOS = re.findall(r"^async def (\w+)\(dut", (HERE / "scenarios.py").read_text(), re.M)


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_scenario(scenario: str, tmp_path: Path) -> None:
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join((str(HERE.parents[2]), *sys.path)),
        "PYGPI_PYTHON_BIN": sys.executable,
        "GPI_USERS": f"{find_libpython.find_libpython()};{cocotb_tools.config.pygpi_entry_point()}",
        "COCOTB_TOPLEVEL": "bpn_core",
        "COCOTB_TEST_MODULES": "tests.rtl.protocol.scenarios",
        "COCOTB_TEST_FILTER": rf"\.{scenario}$",
        "COCOTB_RESULTS_FILE": str(tmp_path / "results.xml"),
        "COCOTB_TRUST_INERTIAL_WRITES": "1",
        "TOPLEVEL_LANG": "verilog",
    }
    done = subprocess.run(
        [model_library(Build(), COCOTB)],
        env=environment,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=900,
    )
    assert "PASS=1 FAIL=0" in done.stdout, done.stdout[-4000:] + done.stderr[-2000:]
