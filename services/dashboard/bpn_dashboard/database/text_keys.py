"""Texts as people mean them, as columns that any database can compare, whatever case or form they are in."""

import re
import unicodedata
from collections.abc import Sequence

_DIGITS = re.compile(r"\d+")


def folded(text: str) -> str:
    """The text without what no search should depend on: case, and in which form Unicode writes it."""
    return unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", text).casefold())


def search_text(*, run_id: str, name: str, notes: str, tags: Sequence[str]) -> str:
    """All that a search for a run looks at, folded, a line for each part."""
    return folded("\n".join((name, notes, *tags, run_id)))


def order_key(name: str) -> str:
    """What names are ordered by: no case, no accents, numbers by size ("bulk 2" before "bulk 10")."""
    decomposed = unicodedata.normalize("NFKD", folded(name))
    plain = "".join(c for c in decomposed if not unicodedata.combining(c))
    return _DIGITS.sub(lambda digits: _sortable(digits[0]), plain)


def _sortable(digits: str) -> str:
    significant = digits.lstrip("0")
    return f"{len(significant):03d}{significant}"


def visible(text: str) -> str:
    """A text on one line without what nobody sees or what turns others around: controls, direction overrides."""
    return " ".join("".join(c if is_visible(c) else " " for c in text).split())


def is_visible(character: str) -> bool:
    """Whether it may stand in a name. Joiners may: scripts and emoji need them."""
    return character in _JOINERS or unicodedata.category(character) not in _INVISIBLE


_JOINERS = "\u200c\u200d"
_INVISIBLE = ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")
