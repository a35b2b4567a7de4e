"""A bitstream for the ULX3S with an ECP5-85F: the core behind the board's USB serial line."""

import json
from pathlib import Path
from typing import Any

from bpn.fpga import tools
from bpn.fpga.synthesis import ECP5_85F, write_sources
from bpn_edge.fpga import sources
from bpn_edge.fpga.build import Build
from bpn_edge.fpga.serial import BAUD

BOARD_MHZ = 25
BITSTREAM = "bpn-ulx3s-85f.bit"


def make(build: Build, clock_mhz: int, where: Path) -> dict[str, Any]:
    """Synthesis, place-and-route, bitstream; minutes.

    Args:
        build: of the core.
        clock_mhz: of the core, from the PLL; a multiple of 3, so that the serial line's clock is exact.
        where: a folder, for all that is made.

    Returns:
        What was measured: Fmax after place-and-route, resources, seconds, tools.

    Raises:
        MissingToolError, CommandError: a tool is not installed, or fails.
    """
    files = write_sources(build, where, "serial/*.sv", "boards/ulx3s/*.sv")
    pins = sources.folder() / "boards/ulx3s/ulx3s.lpf"
    tools.run(
        "ecppll",
        ["-i", str(BOARD_MHZ), "-o", str(clock_mhz), "-n", "bpn_pll", "-f", "bpn_pll.v"],
        where=where,
        log="ecppll.log",
    )
    clocks = clock_mhz * 1_000_000 // BAUD
    script = (
        f"read_verilog -sv {' '.join(files)} bpn_pll.v; chparam -set CLOCKS {clocks} bpn_ulx3s; "
        "synth_ecp5 -top bpn_ulx3s -json bpn_ulx3s.json"
    )
    seconds = {"yosys": tools.run("yosys", ["-q", "-p", script], where=where, log="yosys.log")}
    arguments = [
        "--85k",
        "--speed",
        "6",
        "--package",
        "CABGA381",
        "--json",
        "bpn_ulx3s.json",
        "--lpf",
        str(pins),
    ]
    arguments += [
        "--textcfg",
        "bpn_ulx3s.config",
        "--freq",
        str(clock_mhz),
        "--report",
        "route.json",
        "--seed",
        "1",
    ]
    arguments += ["--timing-allow-fail"]
    seconds["nextpnr"] = tools.run("nextpnr-ecp5", arguments, where=where, log="nextpnr.log")
    seconds["ecppack"] = tools.run(
        "ecppack", ["--compress", "bpn_ulx3s.config", BITSTREAM], where=where, log="ecppack.log"
    )
    figures = {
        "target": "ulx3s-85f",
        "clock_mhz": clock_mhz,
        **routed(json.loads((where / "route.json").read_text())),
        "bitstream_bytes": (where / BITSTREAM).stat().st_size,
        "seconds": {name: round(value, 1) for name, value in seconds.items()},
        "tools": [tools.version(name) for name in ("yosys", "nextpnr-ecp5")],
    }
    (where / "figures.json").write_text(json.dumps(figures, indent=1) + "\n")
    return figures


def routed(report: dict[str, Any]) -> dict[str, Any]:
    """Fmax and resources of nextpnr's report."""
    used = {
        name: report["utilization"][cell]["used"]
        for name, cell in _CELLS.items()
        if cell in report["utilization"]
    }
    return {
        "fmax_mhz": round(max(clock["achieved"] for clock in report["fmax"].values()), 1),
        "used": used,
        "share": {name: round(count / ECP5_85F[name], 3) for name, count in used.items()},
    }


_CELLS = {"LUT": "TRELLIS_COMB", "FF": "TRELLIS_FF", "BRAM18": "DP16KD", "DSP": "MULT18X18D"}
