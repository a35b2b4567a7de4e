"""A bitstream for a board: the core behind the board's serial line."""

import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bpn.fpga import tools
from bpn.fpga.synthesis import write_sources
from bpn_edge.fpga import sources
from bpn_edge.fpga.build import Build
from bpn_edge.fpga.serial import BAUD


@dataclass(frozen=True)
class Board:
    """What one board and its FPGA need.

    Attributes:
        target: as the command line calls it.
        folder: of its shell in the RTL; bpn_<folder> is the top.
        pins: a file there.
        build: what of the core fits.
        clock_mhz: of the core, from the PLL; a multiple of 3, so that the serial line's clock is exact.
        pll: tool and arguments that write bpn_pll.v, for a clock in MHz.
        synthesis: yosys's command, without top and output.
        place_and_route: nextpnr for this family.
        route: its arguments, for pins and a seed's folder.
        pack: tool and arguments that write the bitstream from a seed's folder.
        bitstream: its name.
        clock: what nextpnr's report calls the core's clock, at the name's end.
        cells: names in nextpnr's report, by what people call them.
        has: how many of each the FPGA has.
    """

    target: str
    folder: str
    pins: str
    build: Build
    clock_mhz: int
    pll: Callable[[int], tuple[str, list[str]]]
    synthesis: str
    place_and_route: str
    route: Callable[[Path, str], list[str]]
    pack: Callable[[str], tuple[str, list[str]]]
    bitstream: str
    clock: str
    cells: dict[str, str]
    has: dict[str, int]


def make(board: Board, build: Build, clock_mhz: int, seeds: int, where: Path) -> dict[str, Any]:
    """Synthesis, place-and-route, bitstream; minutes.

    Args:
        board: for which.
        build: of the core.
        clock_mhz: of the core.
        seeds: how often place-and-route is tried, until the clock is met; the best one counts.
        where: a folder, for all that is made.

    Returns:
        What was measured: Fmax after place-and-route, resources, seconds by the clock and of processors, tools.

    Raises:
        MissingToolError, CommandError: a tool is not installed, or fails.
    """
    begun = os.times()
    top, folder = f"bpn_{board.folder}", f"boards/{board.folder}"
    files = write_sources(build, where, "serial/*.sv", f"{folder}/*.sv")
    pll, arguments = board.pll(clock_mhz)
    tools.run(pll, arguments, where=where, log="pll.log")
    script = (
        f"read_verilog -sv {' '.join(files)} bpn_pll.v; "
        f"chparam -set CLOCKS {clock_mhz * 1_000_000 // BAUD} {top}; "
        f"{board.synthesis} -top {top} -json core.json"
    )
    seconds = {"yosys": tools.run("yosys", ["-q", "-p", script], where=where, log="yosys.log")}
    seconds[board.place_and_route] = 0.0
    routed_by: dict[str, dict[str, Any]] = {}
    for seed in map(str, range(1, seeds + 1)):
        (where / seed).mkdir(exist_ok=True)
        arguments = board.route(sources.folder() / folder / board.pins, seed)
        arguments += ["--json", "core.json", "--freq", str(clock_mhz), "--seed", seed]
        arguments += ["--report", f"{seed}/route.json", "--timing-allow-fail"]
        seconds[board.place_and_route] += tools.run(
            board.place_and_route, arguments, where=where, log=f"{seed}/nextpnr.log"
        )
        routed_by[seed] = routed(board, json.loads((where / seed / "route.json").read_text()))
        if routed_by[seed]["fmax_mhz"] >= clock_mhz:
            break
    best = max(routed_by, key=lambda seed: float(routed_by[seed]["fmax_mhz"]))
    pack, arguments = board.pack(best)
    seconds[pack] = tools.run(pack, arguments, where=where, log="pack.log")
    figures = {
        "target": board.target,
        "build": str(build),
        "clock_mhz": clock_mhz,
        "seed": int(best),
        **routed_by[best],
        "bitstream_bytes": (where / board.bitstream).stat().st_size,
        "seconds": {name: round(value, 1) for name, value in seconds.items()},
        "processor_seconds": round(_of_children(os.times()) - _of_children(begun), 1),
        "tools": [tools.version(name) for name in ("yosys", board.place_and_route)],
    }
    (where / "figures.json").write_text(json.dumps(figures, indent=1) + "\n")
    return figures


def _of_children(times: os.times_result) -> float:
    return times.children_user + times.children_system


def routed(board: Board, report: dict[str, Any]) -> dict[str, Any]:
    """Fmax and resources of nextpnr's report."""
    used = {
        name: report["utilization"][cell]["used"]
        for name, cell in board.cells.items()
        if cell in report["utilization"]
    }
    fmax = {name: clock["achieved"] for name, clock in report["fmax"].items()}
    ours = [mhz for name, mhz in fmax.items() if name.endswith(board.clock)]
    return {
        "fmax_mhz": round(min(ours or fmax.values()), 1),
        "used": used,
        "share": {name: round(count / board.has[name], 3) for name, count in used.items()},
    }
