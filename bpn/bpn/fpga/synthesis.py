"""Yosys on the core's sources, and what it says that they take."""

import json
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from bpn.fpga import tools
from bpn_edge.fpga import sources
from bpn_edge.fpga.build import Build

ZU3EG = {"LUT": 70_560, "FF": 141_120, "BRAM36": 216, "DSP": 360}
"""What an xczu3eg has."""
ECP5_85F = {"LUT": 83_640, "FF": 83_640, "BRAM18": 208, "DSP": 156}
"""What an LFE5U-85F has."""
GW2AR_18 = {"LUT": 20_736, "ALU": 15_552, "FF": 15_552, "BRAM18": 46, "DSP": 48}
"""What a GW2AR-18 has."""


@dataclass(frozen=True)
class Cells:
    """Of a netlist, by type."""

    counts: Counter[str]

    @classmethod
    def read(cls, path: Path, top: str) -> "Cells":
        """From yosys's JSON."""
        module = json.loads(path.read_text())["modules"][top]
        return cls(Counter(cell["type"] for cell in module["cells"].values()))

    def xilinx(self) -> dict[str, float]:
        """LUT, FF, BRAM36, DSP; a RAM32M16 takes the eight LUTs of its slice, an SRL one."""
        count = self.counts
        luts = sum(count[f"LUT{inputs}"] for inputs in range(1, 7))
        luts += 8 * sum(n for name, n in count.items() if name.startswith(("RAM32M16", "RAM64M8")))
        luts += sum(n for name, n in count.items() if name.startswith("SRL"))
        flops = sum(n for name, n in count.items() if name.startswith("FD"))
        return {
            "LUT": luts,
            "FF": flops,
            "BRAM36": count["RAMB36E2"] + count["RAMB18E2"] / 2,
            "DSP": sum(n for name, n in count.items() if name.startswith("DSP")),
        }


def write_sources(build: Build, where: Path, *more: str) -> list[str]:
    """Copies the core's sources of a build, and others of the RTL's folder, into a folder.

    Returns:
        Their names there, the package first: what is synthesized depends on the order, a little.
    """
    package = sources.write_package(build, where)
    others = [file for pattern in more for file in sources.folder().glob(pattern)]
    names = []
    for path in (*sources.core_files(), *others):
        (where / path.name).write_text(path.read_text())
        names.append(path.name)
    return [package.name, *sorted(names)]


def estimate_xilinx(build: Build, where: Path) -> dict[str, float]:
    """What the core takes of an UltraScale+, as yosys estimates it before place-and-route, without pins.

    Raises:
        MissingToolError, CommandError: yosys is not installed, or fails.
    """
    files = write_sources(build, where)
    script = (
        f"read_verilog -sv {' '.join(files)}; synth_xilinx -family xcup -flatten -noiopad -top bpn_core; "
        "write_json core.json"
    )
    tools.run("yosys", ["-q", "-p", script], where=where, log="yosys.log")
    return Cells.read(where / "core.json", "bpn_core").xilinx()
