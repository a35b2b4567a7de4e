"""One model of all mutants: environment variable BPN_MUTANT says which one a process has; 0: the core as it is."""

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

from bpn_edge.fpga import device, simulated, sources, verilated
from bpn_edge.fpga.build import Build
from tests.rtl.mutation.places import Mutant, Source

CHOSEN = "BPN_MUTANT"
BUILDS = (Build(), Build(keeps_frame=True))
"""That the tests of `__main__` simulate."""
_PACKAGE = """package bpn_mutants;
  import "DPI-C" function int bpn_chosen();
  int chosen;
endpackage
"""
_CHOOSE = "  initial bpn_mutants::chosen = bpn_mutants::bpn_chosen();\nendmodule\n"
_CHOSEN_IN_C = f"""
#include <cstdlib>
extern "C" int bpn_chosen() {{
  const char *chosen = std::getenv("{CHOSEN}");
  return chosen == nullptr ? 0 : std::atoi(chosen);
}}
"""
HARNESS = verilated.Harness(
    "bpn_core", "sim/bpn_model.cpp", options=("-Wno-fatal",), runtime=("verilated_dpi.cpp",)
)
_TIMEOUT_S = 0.3
"""In place of the driver's: a frame with gaps takes a fifth of that, and mutants hang often."""


def rtl() -> list[Source]:
    """The core as it is."""
    return [Source(path.name, path.read_text()) for path in sources.core_files()]


def write(files: list[Source], numbers: Mapping[Mutant, int], where: Path) -> None:
    """The sources with all mutants in them."""
    original = sources.folder()
    shutil.rmtree(where, ignore_errors=True)
    (where / "sim").mkdir(parents=True)
    for file in files:
        text = file.with_all(numbers)
        if file.name == "bpn_core.sv":
            text = text[: text.rindex("endmodule")] + _CHOOSE
        (where / file.name).write_text(text)
    (where / "bpn_0_mutants.sv").write_text(_PACKAGE)  # before those that use it
    model = (original / "sim/bpn_model.cpp").read_text()
    patient = model.replace("kPatience = 1'000'000", "kPatience = 100'000")
    assert patient != model
    (where / "sim/bpn_model.cpp").write_text(patient + _CHOSEN_IN_C)


def use(where: Path) -> None:
    """From here on tests of this process simulate those sources."""
    os.environ[verilated.CACHE] = str(where.parent)
    sources.folder = lambda: where
    simulated.model_library = lambda build: verilated.model_library(build, HARNESS)  # type: ignore[assignment]
    device._TIMEOUT_S = _TIMEOUT_S
    for build in BUILDS:
        simulated.model_library(build)


def is_proven(mutant: Mutant, files: list[Source], original: Path) -> bool:
    """Whether the proofs hold with it, of which most modules have none."""
    with tempfile.TemporaryDirectory() as made:
        rtl = Path(made) / "rtl"
        shutil.copytree(original, rtl)
        code = next(file.code for file in files if file.name == mutant.file)
        mutated = code[: mutant.begin] + (mutant.after or ";") + code[mutant.end :]
        (rtl / mutant.file).write_text(mutated)
        command = [sys.executable, original / "formal/prove.py", rtl]
        return subprocess.run(command, capture_output=True, check=False).returncode == 0
