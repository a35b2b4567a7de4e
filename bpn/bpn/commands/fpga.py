"""`bpn fpga`: the policy as a circuit: bitstreams, IP for Vivado, and what they take and how fast they are."""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from bpn.fpga import clocks, report, synthesis, ulx3s, zu3eg
from bpn_edge.fpga.build import Build
from bpn_shared.errors import InputError
from bpn_shared.spec.network import NetworkSpec

TARGETS = ("ulx3s-85f", "zu3eg")


def add_options(parser: argparse.ArgumentParser, _arguments: Sequence[str]) -> None:
    actions = parser.add_subparsers(required=True, metavar="ACTION")
    build = actions.add_parser(
        "build",
        help="make a bitstream (ulx3s-85f), or an IP folder for Vivado and an estimate (zu3eg)",
    )
    build.add_argument("--target", choices=TARGETS, required=True)
    build.add_argument(
        "--clock", type=int, default=120, metavar="MHZ", help="of ulx3s-85f (default 120)"
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
        "explore", help="throughput against area: builds of 1 to 16 bytes of pixels a clock"
    )
    explore.add_argument("--network", default="6,100,17", metavar="C,N,A")
    explore.set_defaults(run=run_explore)
    for sub in (build, explore):
        sub.add_argument(
            "--hidden-units", type=int, default=256, help="the largest N that it runs (default 256)"
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
    build = _build(hidden_units=options.hidden_units)
    where = options.out / options.target
    where.mkdir(parents=True, exist_ok=True)
    if options.target == "ulx3s-85f":
        if options.clock % 3 or not 30 <= options.clock <= 300:
            raise InputError(
                f"--clock {options.clock}: a multiple of 3 in 30..300, so that the serial line's 3 MBaud is exact"
            )
        figures = ulx3s.make(build, options.clock, where.resolve())
    else:
        figures = zu3eg.make(build, where.resolve())
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
    for pixel_bytes in (1, 2, 4, 8, 16):
        build = _build(hidden_units=options.hidden_units, pixel_bytes=pixel_bytes)
        measured = clocks.measure(build, spec)
        where = options.out / f"explore-{pixel_bytes}"
        where.mkdir(parents=True, exist_ok=True)
        used = synthesis.estimate_xilinx(build, where.resolve())
        rows.append(
            {
                "pixel_bytes": pixel_bytes,
                "interval": measured.interval,
                "tail": measured.tail,
                **used,
            }
        )
    if options.json:
        print(json.dumps({"network": str(spec), "points": rows}))
        return 0
    table = Table(
        "bytes a clock", "clocks a frame", "clocks after the last pixels", "LUT", "FF", "BRAM36", "DSP",
        title=f"{spec}; each exact in simulation; resources estimated by yosys for xczu3eg",
    )  # fmt: skip
    for row in rows:
        table.add_row(*(f"{value:,.10g}" for value in row.values()))
    Console().print(table)
    return 0


def _build(*, hidden_units: int, pixel_bytes: int = 4) -> Build:
    try:
        return Build(pixel_bytes=pixel_bytes, hidden_units=hidden_units)
    except ValueError as error:
        raise InputError(str(error)) from error


def _network(text: str) -> NetworkSpec:
    try:
        channels, hidden_units, actions = (int(size) for size in text.split(","))
        return NetworkSpec(channels, hidden_units, actions)
    except ValueError as error:
        raise InputError(f"--network {text}: C,N,|A| such as 6,100,17; {error}") from error
