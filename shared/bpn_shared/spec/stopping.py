"""A rule on one metric that ends a run early, such as `eval_return >= 475`."""

import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Self

_SIGNS: dict[str, Callable[[float, float], bool]] = {
    ">=": operator.ge,
    "<=": operator.le,
    ">": operator.gt,
    "<": operator.lt,
}
_RULE = re.compile(r"\s*([A-Za-z][\w.]*)\s*(>=|<=|>|<)\s*(\S+)\s*")


@dataclass(frozen=True, slots=True)
class StopRule:
    """A metric, what it is compared with, and how."""

    metric: str
    sign: str
    bound: float

    @classmethod
    def parse(cls, text: str) -> Self:
        """Reads METRIC SIGN NUMBER.

        Raises:
            ValueError: the text is no rule.
        """
        found = _RULE.fullmatch(text)
        try:
            if found and isfinite(bound := float(found[3])):
                return cls(found[1], found[2], bound)
        except ValueError:
            pass
        raise ValueError(
            f"stop_when = {text!r} is no rule: give a metric, one of {', '.join(_SIGNS)}, and a number, "
            "such as 'eval_return >= 475'"
        )

    def why(self, record: Mapping[str, object]) -> str | None:
        """Why an iteration's record ends the run; None if it does not, or lacks the metric."""
        value = record.get(self.metric)
        if not isinstance(value, int | float) or not _SIGNS[self.sign](value, self.bound):
            return None
        return f"{self.metric} = {value:g} {self.sign} {self.bound:g}"
