"""What a verification found: for every kind of check how much was compared, and what differs."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

Verdict = Literal["ok", "differs", "not judged"]

CHECKS = {
    "files": "every episode, version and record that the run's progress needs",
    "initial weights": "version 0 follows from the seed",
    "seeds": "seed, version and length of every episode",
    "outputs": "what the network says to every observation",
    "actions": "what outputs, policy and seed prescribe, step by step",
    "rewards": "of every step",
    "returns": "returns, lengths, ends and misses in the metrics",
    "epsilon": "share of random actions in the metrics",
    "updates": "optimizer steps, from the size of D",
    "targets": "the largest |P-| and |y| over D",
    "gradients": "of the kernel beside autograd's in float64",
    "losses": "of the first and the last epoch",
    "weights": "every version, trained from the one before",
    "scale": "lambda, and the share of targets beyond its reach",
    "digests": "weights_sha256 of every version",
}
"""By name, in the order in which they are reported: what each compares."""


@dataclass(frozen=True, slots=True)
class Difference:
    """Something that is not as it should be.

    Attributes:
        where: iteration, episode, step.
        hint: what would explain it; "" if nothing that was tried does.
    """

    where: str
    found: str
    expected: str
    hint: str = ""

    def __str__(self) -> str:
        hint = f" ({self.hint})" if self.hint else ""
        return f"{self.where}: {self.found}, expected {self.expected}{hint}"


@dataclass(slots=True)
class Check:
    """One kind of check.

    Attributes:
        compared: how many comparisons were made.
        differences: all of them.
        notes: what was not judged and why, or how closely the rest agrees.
    """

    compared: int = 0
    differences: list[Difference] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def verdict(self) -> Verdict:
        if self.differences:
            return "differs"
        return "ok" if self.compared else "not judged"

    def note(self, text: str) -> None:
        """Adds a note, once."""
        if text not in self.notes:
            self.notes.append(text)


class Findings:
    """All checks of a run."""

    def __init__(self) -> None:
        self.checks = {name: Check() for name in CHECKS}

    def __getitem__(self, name: str) -> Check:
        return self.checks[name]

    @property
    def agrees(self) -> bool:
        """Whether nothing differs."""
        return not any(check.differences for check in self.checks.values())

    def compare(
        self,
        name: str,
        where: str,
        found: object,
        expected: object,
        *,
        tolerance: float = 0.0,
        hint: str = "",
    ) -> bool:
        """Counts a comparison and keeps it if it differs.

        Args:
            tolerance: of numbers, relative to the expected one's size or 1, whichever is larger.
        """
        check = self.checks[name]
        check.compared += 1
        if _equal(found, expected, tolerance):
            return True
        check.differences.append(Difference(where, _text(found), _text(expected), hint))
        return False


def _equal(found: object, expected: object, tolerance: float) -> bool:
    if isinstance(found, int | float) and isinstance(expected, int | float) and tolerance:
        return bool(abs(found - expected) <= tolerance * max(1.0, abs(expected)))
    return bool(found == expected)


def _text(value: object) -> str:
    return f"{value:.7g}" if isinstance(value, float | np.floating) else str(value)
