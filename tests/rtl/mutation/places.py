"""Where the RTL can be changed in one place, and the sources with all those changes, of which one is chosen.

A mutant replaces an expression, or leaves an assignment out. The sources of all have each as the choice of a
number, so that one model serves for all of them: half a minute of building, not that for each.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

RULES = (
    (r"==", "!="), (r"!=", "=="), (r"&&", "||"), (r"\|\|", "&&"), (r"(?<![<>=])>=", "<"),
    (r"(?<=\w) < (?=\w)", " >= "), (r" \+ ", " - "), (r" - (?!>)", " + "), (r"\b1'b1\b", "1'b0"),
    (r"\b1'b0\b", "1'b1"), (r"'0\b", "'1"), (r"!(?=[\w(])", ""), (r"\b(\d)'d(\d)\b", None),
    (r"(?<=\bif \()", "!"), (r"(?<=\? )(\S+) : ([^;,]+)(?=;)", r"\2 : \1"),
)  # fmt: skip
"""What is changed into what; None: the constant into its neighbour."""
LEFT_OUT = re.compile(r"^ +(?:else |[\w:'+ ]+: )*([{\w][\w\[\]:.+*', {}!-]* <= [^;]+;)$")
_NOT_IN_THE_CIRCUIT = re.compile(
    r"\s*(module|parameter|localparam|input|output|logic|import|genvar|for|function|wire unused|\.)"
    r"|.*: gen_|.*\bbpn::BYTES [=!]"
)
"""Declarations, connections, and what is decided when the core is built."""
_OPEN, _CLOSE = "([{", ")]}"


@dataclass(frozen=True)
class Mutant:
    """In a file, text[begin:end] becomes another; `line` is what people read."""

    file: str
    begin: int
    end: int
    after: str
    line: str

    def __str__(self) -> str:
        return f"{self.file}: {self.line}  ->  {self.after}"


@dataclass(frozen=True)
class Source:
    """One file of the RTL."""

    name: str
    text: str

    @cached_property
    def code(self) -> str:
        """Without comments; everything else is where it was."""
        return re.sub(r"//[^\n]*", lambda comment: " " * len(comment[0]), self.text)

    def mutants(self) -> list[Mutant]:
        """All that the rules give."""
        found, at = [], 0
        for line in self.code.splitlines(keepends=True):
            if line.strip() and not _NOT_IN_THE_CIRCUIT.match(line):
                for pattern, replacement in RULES:
                    for match in re.finditer(pattern, line.rstrip()):
                        new = (
                            f"{match[1]}'d{int(match[2]) ^ 1}"
                            if replacement is None
                            else match.expand(replacement)
                        )
                        region = self._expression(at + match.start(), at + match.end())
                        if region is not None:
                            begin, end = region
                            after = (
                                self.code[begin : at + match.start()]
                                + new
                                + self.code[at + match.end() : end]
                            )
                            found.append(Mutant(self.name, begin, end, after, line.strip()))
                if match := LEFT_OUT.match(line.rstrip()):
                    found.append(
                        Mutant(self.name, at + match.start(1), at + match.end(1), "", line.strip())
                    )
            at += len(line)
        return found

    def _expression(self, begin: int, end: int) -> tuple[int, int] | None:
        """The smallest whole expression around a place; None: the place is in none that may depend on a signal."""
        code, depth, at = self.code, 0, begin - 1
        while at >= 0:
            char = code[at]
            if char in _CLOSE:
                depth += 1
            elif char in _OPEN and depth:
                depth -= 1
            elif not depth and char in _OPEN + ",":
                return self._to_its_end(at + 1, end, statement=False)
            elif not depth and char == ";":
                break
            at -= 1
        assignment = self._assignment(at + 1, begin)
        return None if assignment is None else self._to_its_end(assignment, end, statement=True)

    def _assignment(self, begin: int, end: int) -> int | None:
        """Where the right-hand side of a statement begins, if that is before `end`."""
        depth = 0
        for at in range(begin, end):
            char = self.code[at]
            depth += (char in _OPEN) - (char in _CLOSE)
            if depth == 0 and self.code.startswith((" <= ", " = "), at):
                return at + len(" <= ") if self.code[at + 1] == "<" else at + len(" = ")
        return None

    def _to_its_end(self, begin: int, end: int, *, statement: bool) -> tuple[int, int] | None:
        depth = 0
        for at in range(end, len(self.code)):
            char = self.code[at]
            if char in _OPEN:
                depth += 1
            elif char in _CLOSE and depth:
                depth -= 1
            elif not depth and (char in _CLOSE + ",;" or self.code.startswith("+:", at)):
                text = self.code[begin:at]
                wrong = (char == ";") != statement or not text.strip() or ":" in _choices_out(text)
                return None if wrong else (begin, at)
        return None

    def with_all(self, numbers: Mapping[Mutant, int]) -> str:
        """The text in which bpn_mutants::chosen is one of them, or none."""
        ours = [mutant for mutant in numbers if mutant.file == self.name]
        return self._with(0, len(self.code), ours, numbers)

    def _with(
        self, begin: int, end: int, mutants: Iterable[Mutant], numbers: Mapping[Mutant, int]
    ) -> str:
        """Of code[begin:end], which all of the mutants are within."""
        left = sorted(mutants, key=lambda mutant: (mutant.begin, -mutant.end))
        parts, at = [], begin
        while left:
            first = left[0]
            inside = [mutant for mutant in left if mutant.end <= first.end]
            left = [mutant for mutant in left if mutant.end > first.end]
            here = [
                mutant
                for mutant in inside
                if (mutant.begin, mutant.end) == (first.begin, first.end)
            ]
            within = [mutant for mutant in inside if mutant not in here]
            text = self._with(first.begin, first.end, within, numbers)
            for mutant in here:
                chosen = f"bpn_mutants::chosen == {numbers[mutant]}"
                text = (
                    f"({chosen} ? ({mutant.after.strip()}) : ({text.strip()}))"
                    if mutant.after
                    else f"begin if (!({chosen})) {text} end"
                )
            parts += [self.code[at : first.begin], text]
            at = first.end
        return "".join((*parts, self.code[at:end]))


def _choices_out(text: str) -> str:
    """Without the colons of choices, and whatever is in brackets of its own."""
    while (shorter := re.sub(r"\([^()]*\)|\[[^\[\]]*\]|\{[^{}]*\}", "", text)) != text:
        text = shorter
    for _ in range(text.count("?")):
        text = text.replace(":", "", 1)
    return text.replace("::", "")
