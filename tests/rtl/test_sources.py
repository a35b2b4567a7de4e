"""The sources: what is made from one of them is current, and no tool has anything to say of them."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from bpn_edge.fpga import sources
from bpn_edge.fpga.build import Build
from bpn_edge.fpga.verilated import verilator

RTL = sources.folder()
BUILDS = (
    Build(),
    Build(pixel_bytes=1, channels=3, hidden_units=16, actions=2),
    Build(pixel_bytes=8, hidden_units=100),
    Build(pixel_bytes=16, hidden_units=1023),
    Build(keeps_frame=True),
)


def test_what_is_made_from_the_register_map_is_current() -> None:
    done = subprocess.run(
        [sys.executable, RTL / "generate.py", "--check"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("build", BUILDS, ids=str)
def test_verilators_lint_has_nothing_to_say(build: Build, tmp_path: Path) -> None:
    program, environment = verilator()
    package = sources.write_package(build, tmp_path)
    command = [program, "--lint-only", "-Wall", "--top-module", "bpn_serial", package]
    command += [*sources.core_files(), *sorted((RTL / "serial").glob("*.sv"))]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert not done.stderr.strip()


def test_nothing_waives_a_warning_and_nothing_is_a_vendors() -> None:
    for path in [*sources.core_files(), *(RTL / "serial").glob("*.sv")]:
        text = path.read_text()
        assert "lint_off" not in text, path
        assert not re.search(r"\b(DSP48\w*|RAMB\w+|DP16KD|MULT18X18D|EHXPLLL|SB_\w+)\b", text), path


@pytest.mark.parametrize("path", sources.core_files(), ids=lambda path: path.stem)
def test_a_module_says_what_it_is(path: Path) -> None:
    assert path.read_text().startswith("// ")
    assert f"module {path.stem}" in path.read_text()
