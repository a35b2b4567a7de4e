"""What is known of the core: clocks, area, clock rate, beside what others measured of theirs."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from bpn.fpga import clocks
from bpn_edge.fpga.build import Build
from bpn_shared.spec.network import NetworkSpec

NOMINAL_MHZ = 100
OTHERS = (
    ("BPN of the paper, in an FPGA (its Table III)", 4_000.0),
    ("DQN of the paper (its Table III)", 1_003_000.0),
    (
        "FINN CNV-W1A1 (37 times the operations), Ultra96 at 300 MHz, one image (BNN-PYNQ's notebook)",
        527.0,
    ),
    ("the same, batched (BNN-PYNQ's notebook)", 109.3),
)
"""What it is, µs an inference."""


def make(spec: NetworkSpec, built: Path) -> dict[str, Any]:
    """Measures in simulation, and reads what `bpn fpga build` has measured.

    Raises:
        ConfigError: there is no simulator.
    """
    build = Build()
    return {
        "network": str(spec),
        "by_layer": clocks.by_layer(build, spec),
        "measured": asdict(clocks.measure(build, spec)),
        "built": [json.loads(path.read_text()) for path in sorted(built.glob("*/figures.json"))],
    }


def show(result: dict[str, Any]) -> None:
    """Prints tables."""
    console = Console()
    measured, by_layer = result["measured"], result["by_layer"]
    layers = Table("layer", "clocks, by formula", title=result["network"])
    for name, count in by_layer.items():
        layers.add_row(name, f"{count:,}")
    console.print(layers, "conv1 takes the pixels as they come; the others run beside it.")
    rates = {NOMINAL_MHZ: "nominal"} | {
        int(built["fmax_mhz"]): f"{built['target']}, after place-and-route"
        for built in result["built"]
        if "fmax_mhz" in built
    }
    table = Table(
        "measured in simulation",
        "clocks",
        *(f"µs at {mhz} MHz ({why})" for mhz, why in rates.items()),
    )
    for what, key in (
        ("from the first pixels to the outputs", "frame"),
        ("from the last pixels to the outputs", "tail"),
        ("from frame to frame, without a gap", "interval"),
        ("a whole weight set", "load"),
    ):
        table.add_row(
            what, f"{measured[key]:,.10g}", *(f"{measured[key] / mhz:.2f}" for mhz in rates)
        )
    console.print(table)
    others = Table("beside", "µs an inference")
    for name, us in OTHERS:
        others.add_row(name, f"{us:,.1f}")
    console.print(others)
    for built in result["built"]:
        used = built.get("used") or built["estimate"]
        shares = ", ".join(
            f"{count:,.10g} {name} ({built['share'][name]:.1%})" for name, count in used.items()
        )
        rate = (
            f"{built['fmax_mhz']} MHz after place-and-route; "
            if "fmax_mhz" in built
            else "estimate before place-and-route: "
        )
        console.print(f"{built['target']}: {rate}{shares}; {', '.join(built['tools'])}")
    if not result["built"]:
        console.print("Nothing is built yet: bpn fpga build --target ulx3s-85f")
