"""The language in which people ask for runs: `alpha>0.5 and (tag:paper or state:failed) not "first try"`.

    query      = either
    either     = all { "or" all }
    all        = negated { ["and"] negated }
    negated    = [ "not" ] one
    one        = "(" either ")" | field operator values | text
    operator   = ":" | "=" | "!=" | "<" | "<=" | ">" | ">="
    values     = value { "," value }            any of them; of "<" and its like one alone

Words are joined by "and". A text or value with spaces, commas, parentheses or operators in it stands in double
quotes; inside, a backslash takes the next character as it is. Nothing here knows what fields there are.
"""

import re
from dataclasses import dataclass
from typing import Literal, NoReturn

from bpn_dashboard.registry.errors import FilterError

Operator = Literal[":", "=", "!=", "<", "<=", ">", ">="]
MOST_CHARACTERS = 2000
_MOST_NESTED = 50
_MOST_VALUES = 200
"""Values and words together: databases take conditions of some hundred parts, not of a thousand."""

_SPACE = re.compile(r"\s*")
_FIELD = re.compile(r'([^\W\d][^\s()"<>=!:,]*)\s*(<=|>=|!=|=|:|<|>)\s*')
_COMMA = re.compile(r"\s*,\s*")
_QUOTED = re.compile(r'"((?:[^"\\]|\\.)*)"', re.DOTALL)
_WORD = re.compile(r'[^\s()"]+')
_VALUE = re.compile(r'[^\s(),"]+')
_ESCAPE = re.compile(r"\\(.)", re.DOTALL)


class QueryError(FilterError):
    """The query means nothing.

    Attributes:
        position: of the character at which it is wrong, from 0.
    """

    def __init__(self, message: str, position: int) -> None:
        super().__init__(f"at character {position + 1}: {message}")
        self.position = position


@dataclass(frozen=True)
class Text:
    """Runs in which that stands somewhere."""

    text: str
    position: int


@dataclass(frozen=True)
class Comparison:
    """Runs whose field is that of one of the values.

    Attributes:
        position: of the field.
        at: where the first value begins.
    """

    field: str
    operator: Operator
    values: tuple[str, ...]
    position: int
    at: int


@dataclass(frozen=True)
class Not:
    """All others."""

    of: "Node"


@dataclass(frozen=True)
class Both:
    """Runs that meet every part."""

    parts: tuple["Node", ...]


@dataclass(frozen=True)
class Either:
    """Runs that meet a part."""

    parts: tuple["Node", ...]


Node = Text | Comparison | Not | Both | Either


def parse(text: str) -> Node | None:
    """What a query asks for; None of an empty one: everything.

    Raises:
        QueryError: it is none; the message says what is wrong, and at which character.
    """
    if len(text) > MOST_CHARACTERS:
        raise QueryError(f"a query has at most {MOST_CHARACTERS} characters", MOST_CHARACTERS)
    if "\0" in text:  # which no database can look for
        raise QueryError("there is a character that no text has", text.index("\0"))
    return _Parser(text).whole()


class _Parser:
    def __init__(self, text: str) -> None:
        self._text, self._at, self._nested, self._values_seen = text, 0, 0, 0

    def whole(self) -> Node | None:
        self._skip()
        if self._done:
            return None
        found = self._either()
        if not self._done:
            self._fail("there is no ( for this )")
        return found

    @property
    def _done(self) -> bool:
        return self._at == len(self._text)

    def _fail(self, message: str) -> NoReturn:
        raise QueryError(message, self._at)

    def _skip(self) -> None:
        found = _SPACE.match(self._text, self._at)
        assert found is not None
        self._at = found.end()

    def _match(self, pattern: re.Pattern[str]) -> re.Match[str] | None:
        found = pattern.match(self._text, self._at)
        if found is not None:
            self._at = found.end()
        return found

    def _keyword(self, word: str) -> bool:
        """Takes the word, if it is the next one."""
        found = _WORD.match(self._text, self._at)
        if found is None or found[0].lower() != word:
            return False
        self._at = found.end()
        self._skip()
        return True

    def _is_next(self, *words: str) -> bool:
        found = _WORD.match(self._text, self._at)
        return found is not None and found[0].lower() in words

    def _either(self) -> Node:
        parts = [self._all()]
        while self._keyword("or"):
            parts.append(self._all())
        return parts[0] if len(parts) == 1 else Either(tuple(parts))

    def _all(self) -> Node:
        parts = [self._negated()]
        while not self._done and self._text[self._at] != ")" and not self._is_next("or"):
            self._keyword("and")
            parts.append(self._negated())
        return parts[0] if len(parts) == 1 else Both(tuple(parts))

    def _negated(self) -> Node:
        self._nested += 1
        if self._nested > _MOST_NESTED:
            self._fail(f"more than {_MOST_NESTED} parts within each other")
        found = Not(self._negated()) if self._keyword("not") else self._one()
        self._nested -= 1
        self._skip()
        return found

    def _one(self) -> Node:
        if self._done:
            self._fail("something is to follow here")
        if self._text[self._at] == "(":
            self._at += 1
            self._skip()
            inside = self._either()
            if self._done:
                self._fail("a ) is missing")
            self._at += 1  # nothing else ends what is inside
            return inside
        begin = self._at
        if (field := self._match(_FIELD)) is not None:
            at = self._at
            values = self._values(field[2])
            return Comparison(field[1], field[2], values, begin, at)  # type: ignore[arg-type]
        if self._is_next("and", "or"):
            self._fail(f"nothing to join stands before this {self._text[begin:].split()[0]}")
        return Text(self._value(_WORD), begin)

    def _values(self, operator: str) -> tuple[str, ...]:
        values = [self._value(_VALUE)]
        while (comma := self._match(_COMMA)) is not None:
            if operator not in (":", "=", "!="):
                raise QueryError(f"{operator} takes one value", comma.start())
            values.append(self._value(_VALUE))
        return tuple(values)

    def _value(self, pattern: re.Pattern[str]) -> str:
        begin, value = self._at, self._read(pattern)
        self._values_seen += max(1, len(value.split()))
        if self._values_seen > _MOST_VALUES:
            raise QueryError(f"a query has at most {_MOST_VALUES} words and values", begin)
        return value

    def _read(self, pattern: re.Pattern[str]) -> str:
        if (quoted := self._match(_QUOTED)) is not None:
            return _ESCAPE.sub(r"\1", quoted[1])
        if not self._done and self._text[self._at] == '"':
            self._fail("the text that begins here has no second quotation mark")
        found = self._match(pattern)
        if found is None:
            self._fail("a value is to follow here")
        return found[0]
