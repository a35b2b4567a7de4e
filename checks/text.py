"""Markdown as the checks read it: figures, tables, headings, links. All pure."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

NUMBER = r"(?<![\w.,])-?\d+(?:,\d{3})*(?:\.\d+)?"
_UNIT = (
    r"us|µs|ms|s|min|px|%|x(?! ?\d)|KB|kB|KiB|MB|MiB|GB|GMAC/s|seconds?|minutes?|hours?|steps?|times|bytes|"
    r"weights|seeds?|trials?|runs?|points|updates|frames|fps|per second|a second|of a core"
)
_FIGURE = re.compile(rf"{NUMBER}(?:/s|[ -]?(?:{_UNIT})(?![\w/])(?:/s)?)")
_ANY_NUMBER = re.compile(NUMBER)
_FENCED = re.compile(r"^(```|~~~).*?^\1", re.MULTILINE | re.DOTALL)
_INDENTED = re.compile(r"^ {4,}\S.*$", re.MULTILINE)
_NOT_PROSE = re.compile(r"``.+?``|`[^`\n]+`|<!--.*?-->|<[^>\n]+>|\]\([^)\n]*\)", re.DOTALL)
_HEADING = re.compile(r"^(#{1,6}) +(.+?) *#*$", re.MULTILINE)
_LINK = re.compile(r"\]\(([^)\s]+)\)|(?:src|srcset|href)=\"([^\"]+)\"")


def numbers(text: str) -> list[str]:
    """The numbers in a text, in order and as written, without separators of thousands."""
    return [found.replace(",", "") for found in _ANY_NUMBER.findall(text)]


def _blank(pattern: re.Pattern[str], text: str) -> str:
    return pattern.sub(lambda found: re.sub(r"[^\n]", " ", found[0]), text)


def without_code(text: str) -> str:
    """The page with code blocks blanked, every place as before."""
    return _blank(_INDENTED, _blank(_FENCED, text))


@dataclass(frozen=True)
class Figure:
    """A number that somebody may believe: its text and its place in the page."""

    text: str
    start: int
    end: int


def figures(page: str, *, whole_tables: bool = False) -> Iterator[Figure]:
    """Numbers with a unit; with `whole_tables` also every other number in a table's row.

    Code, link targets and HTML are left out.
    """
    text = _blank(_NOT_PROSE, without_code(page))
    place = 0
    for line in text.splitlines(keepends=True):
        pattern = _ANY_NUMBER if whole_tables and line.startswith("|") else _FIGURE
        for found in pattern.finditer(line):
            yield Figure(found[0], place + found.start(), place + found.end())
        place += len(line)


def section(page: str, heading: str) -> tuple[int, int] | None:
    """Where the section of this heading begins and ends; None if there is none."""
    headings = list(_HEADING.finditer(without_code(page)))
    for index, found in enumerate(headings):
        if found[2] == heading:
            after = (one.start() for one in headings[index + 1 :] if len(one[1]) <= len(found[1]))
            return found.start(), next(after, len(page))
    return None


def anchors(page: str) -> set[str]:
    """What links to this page may have after #, as GitHub makes them of its headings."""
    found: set[str] = set()
    for heading in _HEADING.finditer(without_code(page)):
        text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading[2])
        slug = re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", "-")
        repeats = sum(1 for one in found if re.fullmatch(re.escape(slug) + r"(-\d+)?", one))
        found.add(f"{slug}-{repeats}" if repeats else slug)
    return found


def links(page: str) -> Iterator[tuple[int, str]]:
    """Line and target of every link and picture outside of code."""
    text = _blank(re.compile(r"`[^`\n]+`(?!\])"), without_code(page))
    for found in _LINK.finditer(text):
        yield text.count("\n", 0, found.start()) + 1, found[1] or found[2]


def tables(page: str) -> Iterator[list[list[str]]]:
    """Every table: rows of cells, the heading first, without the line below it."""
    for block in re.findall(r"(?:^\|.*\n?)+", without_code(page), re.MULTILINE):
        rows = [
            [cell.strip() for cell in re.split(r"(?<!\\)\|", line.strip()[1:-1])]
            for line in block.splitlines()
        ]
        yield [rows[0], *rows[2:]]
