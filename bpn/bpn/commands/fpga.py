"""`bpn fpga`: the policy as a circuit: bitstreams, IP for Vivado, and what they take and how fast they are."""

import argparse
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from bpn.fpga import board, clocks, report, synthesis, zu3eg
from bpn.fpga.tangnano20k import TANGNANO20K
from bpn.fpga.ulx3s import ULX3S
from bpn_edge.fpga.build import Build
from bpn_shared.errors import InputError
from bpn_shared.spec.network import NetworkSpec

BOARDS = {board.target: board for board in (ULX3S, TANGNANO20K)}
ZU3EG = "zu3eg"
POINTS = [(size, False) for size in (1, 2, 4, 8, 16)] + [(size, True) for size in (4, 8, 16)]
"""Of `explore`: bytes of pixels a clock, and whether only the newer of two stacked frames is sent."""


def add_options(parser: argparse.ArgumentParser, _arguments: Sequence[str]) -> None:
    actions = parser.add_subparsers(required=True, metavar="ACTION")
    build = actions.add_parser(
        "build",
        help=f"make a bitstream ({', '.join(BOARDS)}), or an IP folder for Vivado and an estimate ({ZU3EG})",
    )
    build.add_argument("--target", choices=(*BOARDS, ZU3EG), required=True)
    build.add_argument(
        "--clock",
        type=int,
        metavar="MHZ",
        help=f"default: {', '.join(f'{board.clock_mhz} of {name}' for name, board in BOARDS.items())}",
    )
    build.add_argument(
        "--seeds",
        type=int,
        default=1,
        metavar="N",
        help="how often place-and-route is tried, until it meets the clock (default 1)",
    )
    build.add_argument(
        "--keeps-frame",
        action="store_true",
        help="of two stacked frames only the newer one is sent; conv1 is twice as large",
    )
    build.set_defaults(run=run_build)
    show = actions.add_parser(
        "report", help="clocks measured in simulation, what was built, beside the paper's figures"
    )
    show.add_argument(
        "--network",
        default="6,100,17",
        metavar="C,N,A",
        help="default 6,100,17, the paper's DPP policy",
    )
    show.set_defaults(run=run_report)
    explore = actions.add_parser(
        "explore",
        help="throughput against area: 1 to 16 bytes of pixels a clock, also where only newer frames are sent",
    )
    explore.add_argument("--network", default="6,100,17", metavar="C,N,A")
    explore.set_defaults(run=run_explore)
    for sub in (build, explore):
        sub.add_argument(
            "--hidden-units",
            type=int,
            help="the largest N that it runs (default 256; of tangnano20k "
            f"{TANGNANO20K.build.hidden_units})",
        )
    for sub in (build, show, explore):
        sub.add_argument(
            "--out",
            type=Path,
            default=Path("build/fpga"),
            help="folder of what is made (default build/fpga)",
        )
        sub.add_argument("--json", action="store_true", help="print one JSON object")


def run_build(options: argparse.Namespace) -> int:
    """Makes what `--target` says."""
    to = BOARDS.get(options.target)
    build = _build(
        to.build if to else Build(), options.hidden_units, keeps_frame=options.keeps_frame
    )
    where = options.out / options.target
    where.mkdir(parents=True, exist_ok=True)
    if to is None:
        figures = zu3eg.make(build, where.resolve())
    else:
        clock = options.clock or to.clock_mhz
        if clock % 3 or not 27 <= clock <= 300:
            raise InputError(
                f"--clock {clock}: a multiple of 3 in 27..300, so that the serial line's 3 MBaud is exact"
            )
        if not 1 <= options.seeds <= 100:
            raise InputError(f"--seeds {options.seeds} must be in 1..100")
        figures = board.make(to, build, clock, options.seeds, where.resolve())
    if options.json:
        print(json.dumps(figures))
    else:
        for name, value in figures.items():
            print(f"{name}: {value}")
        print(f"in {where}")
    return 0


def run_report(options: argparse.Namespace) -> int:
    """Shows clocks and what was built."""
    result = report.make(_network(options.network), options.out)
    if options.json:
        print(json.dumps(result))
    else:
        report.show(result)
    return 0


def run_explore(options: argparse.Namespace) -> int:
    """Simulates and synthesizes each folding, and shows them side by side."""
    spec, rows = _network(options.network), []
    for pixel_bytes, keeps_frame in POINTS:
        build = _build(
            Build(), options.hidden_units, pixel_bytes=pixel_bytes, keeps_frame=keeps_frame
        )
        measured = clocks.measure(build, spec)
        where = options.out / f"explore-{pixel_bytes}{'-keeps-frame' * keeps_frame}"
        where.mkdir(parents=True, exist_ok=True)
        used = synthesis.estimate_xilinx(build, where.resolve())
        rows.append(
            {
                "pixel_bytes": pixel_bytes,
                "keeps_frame": keeps_frame,
                "interval": measured.interval,
                "tail": measured.tail,
                **used,
            }
        )
    if options.json:
        print(json.dumps({"network": str(spec), "points": rows}))
        return 0
    table = Table(
        "bytes a clock", "keeps a frame", "clocks a frame", "clocks after the last pixels",
        "LUT", "FF", "BRAM36", "DSP",
        title=f"{spec}; each exact in simulation; resources estimated by yosys for xczu3eg",
    )  # fmt: skip
    for row in rows:
        table.add_row(
            *(
                f"{value:,.10g}" if not isinstance(value, bool) else "yes" * value
                for value in row.values()
            )
        )
    Console().print(table)
    return 0


def _build(of: Build, hidden_units: int | None, **changes: Any) -> Build:
    """A build with other sizes."""
    try:
        return replace(of, hidden_units=hidden_units or of.hidden_units, **changes)
    except ValueError as error:
        raise InputError(str(error)) from error


def _network(text: str) -> NetworkSpec:
    try:
        channels, hidden_units, actions = (int(size) for size in text.split(","))
        return NetworkSpec(channels, hidden_units, actions)
    except ValueError as error:
        raise InputError(f"--network {text}: C,N,|A| such as 6,100,17; {error}") from error
