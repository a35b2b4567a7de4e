"""Why runs failed, gathered: reasons that differ in numbers and names of one run alone are the same reason."""

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

_PART = re.compile(r"[0-9a-f]{8}-[0-9a-f-]{27}|0x[0-9a-f]+|\d+(?:\.\d+)?", re.IGNORECASE)
_LEAST = 4


@dataclass(frozen=True)
class Reason:
    """A reason with how many runs have it.

    Attributes:
        example: what one of them says, on one line.
        part: the longest text that all of them have: to search by.
    """

    example: str
    part: str
    runs: int


def reason_of(error: str) -> str:
    """The line of an error that says what happened: a traceback's last, else the first."""
    lines = [line.strip() for line in error.splitlines() if line.strip()]
    if not lines:
        return ""
    return lines[-1] if any(line.startswith("Traceback (") for line in lines) else lines[0]


def gather(errors: Iterable[tuple[str, int]]) -> list[Reason]:
    """From errors, each with how many runs have it, to reasons; those of most runs first."""
    counts: Counter[str] = Counter()
    examples: dict[str, str] = {}
    for error, runs in errors:
        line = reason_of(error)
        pattern = _PART.sub("\0", line)
        counts[pattern] += runs
        examples.setdefault(pattern, line)
    return [
        Reason(examples[pattern], _part(pattern), runs)
        for pattern, runs in sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    ]


def _part(pattern: str) -> str:
    longest = max(pattern.split("\0"), key=len).strip()
    return longest if len(longest) >= _LEAST else ""
