"""`bpn bench dashboard`: what the dashboard can take, and what it costs those who do the work."""

from typing import Any

from rich.console import Console
from rich.table import Table

from bpn.bench import live, rest
from bpn.bench.machine import machine

_SERIES = f"{rest.RUNS} runs of {rest.POINTS:,} points in groups"
_REST = {
    "group_cold_ms": f"{_SERIES}: first view, ms",
    "group_warm_ms": "  the same view again, ms",
    "zoom_ms": "  zoom to another range, ms",
    "list_ms": f"{rest.LISTED:,} runs: first page, ms",
    "filter_ms": "  filtered, ms",
    "sort_ms": "  sorted, ms",
    "points_per_s": "points taken in a second",
    "bytes_per_point": "bytes stored for a point",
}


def run() -> dict[str, Any]:
    """Measures all parts; the result has one entry for each."""
    return {"rest": rest.measure(), "live": live.measure(), "machine": machine()}


def met(result: dict[str, Any]) -> bool:
    """Whether every part reaches its targets."""
    return rest.met(result["rest"]) and live.met(result["live"])


def show(result: dict[str, Any]) -> None:
    """Prints the measurement as a table."""
    table = Table("what", "measured", "target", title="dashboard")
    for name, target in rest.TARGETS.items():
        sign = "≥" if name == "points_per_s" else "≤"
        table.add_row(_REST[name], f"{result['rest'][name]:,.1f}", f"{sign} {target:,.0f}")
    cameras, deaf = result["live"]["cameras"], result["live"]["deaf_client"]
    ages = cameras["capture_to_client_ms"]
    cpu, steps, growth = live.TARGETS.values()
    table.add_row(
        f"{live.CAMERAS} cameras at {live.FPS:.0f} fps: server CPU, % of a core",
        f"{cameras['server_cpu_percent']:.1f} (idle {cameras['idle_cpu_percent']:.1f})",
        f"≤ {cpu:.0f}",
    )
    table.add_row(
        "  frames a second, the slowest", f"{cameras['fps']:.1f}", f"> {live.FPS - 1:.0f}"
    )
    table.add_row("  capture to client, ms p50 / p99", f"{ages['p50']:.1f} / {ages['p99']:.1f}", "")
    table.add_row(
        "client that reads nothing: steps/s of the loop, %",
        f"{deaf['steps_change_percent']:+.2f} of {deaf['steps_per_s']:.0f}",
        f"± {steps:.0f}",
    )
    table.add_row("  server memory, MB", f"{deaf['server_growth_mb']:+.1f}", f"< {growth:.0f}")
    Console().print(table)
