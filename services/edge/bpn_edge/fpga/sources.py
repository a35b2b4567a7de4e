"""Where the core's SystemVerilog is."""

from pathlib import Path

from bpn_edge.fpga.build import Build
from bpn_edge.fpga.package import render

_PACKAGE = Path(__file__).parents[1]


def folder() -> Path:
    """`services/edge/rtl` of the repository, or what the installed package has of it."""
    installed = _PACKAGE / "rtl"
    return installed if installed.is_dir() else _PACKAGE.parent / "rtl"


def core_files() -> list[Path]:
    """The core's modules, without the package that `write_package` makes."""
    return sorted(folder().glob("bpn_*.sv"))


def write_package(build: Build, where: Path) -> Path:
    """Writes bpn.sv of a build into a folder."""
    path = where / "bpn.sv"
    path.write_text(render(build))
    return path
