"""`bpn bench dashboard`: what the dashboard can take, and what it costs those who do the work.

Parts, each on data of its own: `series` (100 runs of 100,000 points), `lists` (10,000 runs), `ingest`, `cameras`,
`deaf` (a client that reads nothing), and `browser`: the first two as somebody sees them in Chromium.
"""

import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from bpn import optional
from bpn.bench import live, rest
from bpn.bench.figures import add_rows, all_met, told_only
from bpn.bench.machine import machine
from bpn.bench.served import router, serving
from bpn.bench.sizes import QUICK, Sizes
from bpn.local_run import private_endpoint
from bpn_shared.spec.config import ConfigError

PARTS = ("series", "lists", "ingest", "cameras", "deaf", "browser")

Measured = tuple[list[dict[str, Any]], dict[str, Any]]


def run(*, parts: Sequence[str] = PARTS, quick: bool = False) -> dict[str, Any]:
    """Measures.

    Args:
        quick: small, to see that everything works; the targets are not of that size, and judge nothing.

    Returns:
        figures (name, title, value, interval, target, bound, met), samples that they are medians of, sizes,
        machine (its load before the measurement), took_s.

    Raises:
        ConfigError: a part is unknown, or what it needs is not installed.
    """
    unknown = set(parts) - set(PARTS)
    if unknown:
        raise ConfigError(f"--parts {', '.join(sorted(unknown))}: there are {', '.join(PARTS)}")
    sizes, measured_on, start_s = QUICK if quick else Sizes(), machine(), time.monotonic()
    figures: list[dict[str, Any]] = []
    samples: dict[str, Any] = {}
    with tempfile.TemporaryDirectory(prefix="bpn-bench-") as directory:
        for told, values in _parts(Path(directory), frozenset(parts), sizes):
            figures += map(_unjudged, told) if quick else told
            samples |= values
    return {
        "figures": told_only(figures) if quick else figures,
        "samples": samples,
        "sizes": vars(sizes),
        "machine": measured_on,
        "took_s": round(time.monotonic() - start_s),
    }


def _parts(directory: Path, parts: frozenset[str], sizes: Sizes) -> Iterator[Measured]:
    browser: Any = None
    if "browser" in parts:  # what is missing is said before the measurement, not after
        browser = optional.load(
            "bpn.bench.browser", extra="bench", wanted_by="`bpn bench dashboard --parts browser`"
        )
    folders = {part: directory / part for part in PARTS}
    for folder in folders.values():
        folder.mkdir()
    if parts & {"series", "browser"}:
        bytes_per_point = rest.make_series(folders["series"], sizes)
        endpoint = private_endpoint()
        with serving(folders["series"], endpoint, [router(endpoint)]) as served:
            if browser is not None:
                yield browser.measure_compare(served, sizes)
            if "series" in parts:
                yield rest.measure_series(served, sizes, bytes_per_point)
    if parts & {"lists", "browser"}:
        rest.make_lists(folders["lists"], sizes)
        endpoint = private_endpoint()
        with serving(folders["lists"], endpoint, [router(endpoint)]) as served:
            if "lists" in parts:
                yield rest.measure_lists(served, sizes)
            if browser is not None:
                yield browser.measure_table(served, sizes)
    if "ingest" in parts:
        yield rest.measure_ingest(folders["ingest"], sizes)
    if "cameras" in parts:
        yield live.measure_cameras(folders["cameras"], sizes)
    if "deaf" in parts:
        yield live.measure_deaf_client(folders["deaf"], sizes)


def _unjudged(figure: dict[str, Any]) -> dict[str, Any]:
    """Without its target, which is of the whole measurement."""
    return figure | {"target": None, "bound": None, "met": None}


def met(result: dict[str, Any]) -> bool:
    """Whether every figure reaches its target."""
    return all_met(result["figures"])


def show(result: dict[str, Any]) -> None:
    """Prints the figures beside their targets."""
    sizes, host = result["sizes"], result["machine"]
    table = Table(
        "what",
        title=f"dashboard: {sizes['runs']} runs of {sizes['points']:,} points, {sizes['listed']:,} runs listed",
        caption=f"{host['cpu']}, {host['cores']} cores, load {host['load_average'][0]}, {result['took_s']} s; "
        "in brackets: 95 % confidence",
    )
    for heading in ("measured", "target", ""):
        table.add_column(heading, justify="right")
    add_rows(table, result["figures"])
    Console().print(table)
