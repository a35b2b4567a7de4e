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
_EVALUATED = frozenset({"eval_return", "eval_success", "eval_s"})
_ALWAYS = frozenset({
    "iteration", "attempt", "time_unix_s", "episodes", "transitions", "length", "terminated", "successes",
    "deadline_misses", "loss_first", "loss", "max_preference", "max_target", "scale", "entropy", "agreement",
    "reward_scale", "saturation", "epsilon", "updates", "update_s", "exchange_s", "weights_version_lag",
    "weights_version", "collect_s", "iteration_s",
})  # fmt: skip
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

    def check(self, return_metric: str, *, evaluated: bool) -> None:
        """That the metric is one of those that a run without callbacks of others writes down.

        Raises:
            ValueError: it is not, so that the rule would never hold.
        """
        rule = f"stop_when = '{self.metric} {self.sign} {self.bound:g}'"
        if self.metric in _EVALUATED and not evaluated:
            raise ValueError(
                f"{rule} with evaluate_every = 0: nothing is evaluated; set it above 0"
            )
        known = _ALWAYS | _EVALUATED | {return_metric}
        if self.metric not in known:
            raise ValueError(f"{rule}: there is no such metric; one of: {', '.join(sorted(known))}")

    def why(self, record: Mapping[str, object]) -> str | None:
        """Why an iteration's record ends the run; None if it does not, or lacks the metric."""
        value = record.get(self.metric)
        if not isinstance(value, int | float) or not _SIGNS[self.sign](value, self.bound):
            return None
        return f"{self.metric} = {value:g} {self.sign} {self.bound:g}"
