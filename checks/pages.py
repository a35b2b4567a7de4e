"""The pages in docs/results against the documents that they are made of."""

import json
from collections.abc import Iterator
from pathlib import Path

from bpn.reproduce.report import page
from bpn.reproduce.targets import TARGETS

RESULTS = "docs/results"


def check(root: Path) -> Iterator[str]:
    """One line for every page that the code would write otherwise."""
    for name, target in TARGETS.items():
        made = root / RESULTS / f"{name}.json"
        if made.is_file():
            shown = made.with_suffix(".md")
            if not shown.is_file() or shown.read_text() != page(
                target, json.loads(made.read_bytes())
            ):
                yield f"{RESULTS}/{name}.md is not what {name}.json gives: bpn reproduce {name} --redraw"
