"""Figures in pages against their sources, as `docs/claims.toml` tells them.

A claim is a piece of a page's text with figures in it, and where they are from:

    [[from]]       page, says, are     a result's file; each number is compared, to the digits that the page shows
    [[measured]]   page, says or section, command, on     no file has them: the command that measures them, and
                                       what on (machine, load, day)
    [[chosen]]     page, says, why     no measurement: a setting, a size, arithmetic, or the paper's

A piece that the page no longer says is a fault, and so is a figure on one of the pages `accounted` that no claim covers.
"""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from checks.sources import SourceError, values
from checks.text import figures, numbers, section

CLAIMS = "docs/claims.toml"
_KEYS = {
    "from": {"page", "says", "are"},
    "measured": {"page", "says", "section", "command", "on"},
    "chosen": {"page", "says", "section", "why"},
}
_NEEDED = {"from": {"page", "says", "are"}, "measured": {"page", "command", "on"}, "chosen": {"page", "why"}}  # fmt: skip


def check(root: Path) -> Iterator[str]:
    """One line for every fault."""
    claims = tomllib.loads((root / CLAIMS).read_text())
    covered: dict[str, list[tuple[int, int]]] = {}
    for kind, claim in ((kind, claim) for kind in _KEYS for claim in claims.get(kind, [])):
        wrong = (set(claim) - _KEYS[kind]) | (_NEEDED[kind] - set(claim))
        if wrong or ("says" in claim) == ("section" in claim):
            yield f"{CLAIMS}: [[{kind}]] {claim}: look at {', '.join(sorted(wrong)) or 'says, section'}"
            continue
        page = (root / claim["page"]).read_text()
        places = _places(page, claim)
        if not places:
            what = claim.get("says") or f"## {claim['section']}"
            yield f"{claim['page']} does not say {what!r}, which {CLAIMS} has"
        covered.setdefault(claim["page"], []).extend(places)
        if kind == "from":
            yield from _compare(claim, root)
    for name, how in claims["accounted"].items():
        page = (root / name).read_text()
        for figure in figures(page, whole_tables=how == "whole tables"):
            if not any(a <= figure.start and figure.end <= b for a, b in covered.get(name, [])):
                line = page.count("\n", 0, figure.start) + 1
                yield f"{name}:{line}: {figure.text!r} is accounted for nowhere in {CLAIMS}"


def _places(page: str, claim: dict[str, Any]) -> list[tuple[int, int]]:
    if "section" in claim:
        found = section(page, claim["section"])
        return [found] if found else []
    pattern = (
        r"(?<![\d.])" + r"\s+".join(map(re.escape, claim["says"].split())) + r"(?![\d]|[.,]\d)"
    )
    return [match.span() for match in re.finditer(pattern, page)]


def _compare(claim: dict[str, Any], root: Path) -> Iterator[str]:
    where = f"{claim['page']}: {claim['says']!r}"
    try:
        measured = [value for reference in claim["are"] for value in values(reference, root)]
    except SourceError as error:
        yield f"{where}: {error}"
        return
    said = numbers(claim["says"])
    if len(said) != len(measured):
        yield f"{where} has {len(said)} numbers and its sources {len(measured)}: {measured}"
        return
    for text, value in zip(said, measured, strict=True):
        if not shows(text, value):
            yield f"{where}: {text} is {value:.10g} in the results"


def shows(text: str, value: float) -> bool:
    """Whether a number as written is the value, rounded to the digits that it has behind the point."""
    digits = len(text.partition(".")[2])
    return abs(float(text) - value) <= 0.5 * 10.0**-digits + 1e-9 * abs(value)
