"""Figures in pages against their sources, as `docs/claims.toml` tells them.

A claim is a piece of a page's text with figures in it (or "## Heading", a whole section), and where they are from:

    from       [piece, source, ...]          results: every number is compared, to the digits that the page shows
    measured   [piece, command, where, when] no file has them: what measures them, and what they were measured on
    chosen     [piece, why]                  no measurement: a setting, a size, arithmetic, or the paper's

A piece that the page does not say is a fault, and so is a figure of the page that no claim covers.
"""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from checks.sources import SourceError, values
from checks.text import figures, numbers, section

CLAIMS = "docs/claims.toml"
_LENGTHS = {"from": range(2, 20), "measured": range(4, 5), "chosen": range(2, 3)}
_FIGURES = ("units", "whole tables")


def check(root: Path) -> Iterator[str]:
    """One line for every fault."""
    for name, claims in tomllib.loads((root / CLAIMS).read_text()).items():
        yield from check_page(name, claims, root)


def check_page(name: str, claims: dict[str, Any], root: Path) -> Iterator[str]:
    """The faults of one page; its `figures` are those with units, or all numbers of its tables as well."""
    unknown = set(claims) - {"figures", *_LENGTHS}
    if unknown or claims.get("figures") not in _FIGURES:
        yield f"{CLAIMS}: {name} has {', '.join(sorted(unknown)) or 'no figures ='}"
        return
    page = (root / name).read_text()
    covered: list[tuple[int, int]] = []
    for kind, lengths in _LENGTHS.items():
        for piece, *rest in claims.get(kind, []):
            places = _places(page, piece)
            covered += places
            if not places:
                yield f"{name} does not say {piece!r}, which {CLAIMS} has"
            if 1 + len(rest) not in lengths or not all(rest):
                yield f"{CLAIMS}: {name}, {kind}: {piece!r} lacks where it is from"
            elif kind == "from":
                yield from _compare(f"{name}: {piece!r}", numbers(piece), rest, root)
    for figure in figures(page, whole_tables=claims["figures"] == "whole tables"):
        if not any(start <= figure.start and figure.end <= end for start, end in covered):
            line = page.count("\n", 0, figure.start) + 1
            yield f"{name}:{line}: {figure.text!r} is accounted for nowhere in {CLAIMS}"


def _places(page: str, piece: str) -> list[tuple[int, int]]:
    """Where the page says it, however its lines are broken."""
    if piece.startswith("## "):
        found = section(page, piece.removeprefix("## "))
        return [found] if found else []
    words = r"\s+".join(map(re.escape, piece.split()))
    return [match.span() for match in re.finditer(rf"(?<![\d.]){words}(?!\d|[.,]\d)", page)]


def _compare(where: str, said: list[str], sources: list[str], root: Path) -> Iterator[str]:
    try:
        measured = [value for source in sources for value in values(source, root)]
    except SourceError as error:
        yield f"{where}: {error}"
        return
    if len(said) != len(measured):
        yield f"{where} has {len(said)} numbers and its sources {len(measured)}: {measured}"
        return
    for text, value in zip(said, measured, strict=True):
        if not shows(text, value):
            yield f"{where}: {text} is {value:.10g} in the results"


def shows(text: str, value: float) -> bool:
    """Whether a number as written is the value, rounded to the digits that it has behind the point."""
    digits = len(text.partition(".")[2])
    return abs(float(text) - value) <= 0.5 * 10.0**-digits + 1e-12 * abs(value)
