"""Figures that a measurement reports, each beside its target."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from rich.table import Table

Bound = Literal["most", "least", "within"]


@dataclass(frozen=True)
class Figure:
    """What is measured.

    Attributes:
        name: in JSON, with its unit.
        title: for people, with its unit.
        target: what it shall be; None: it is only told.
        bound: the target is the most or the least that it may be, or the most of its magnitude.
        digits: behind the point.
    """

    name: str
    title: str
    target: float | None = None
    bound: Bound = "most"
    digits: int = 1

    def result(self, value: float, interval: tuple[float, float] | None = None) -> dict[str, Any]:
        """The figure as JSON.

        Args:
            interval: where the true value is with 95 % confidence.
        """
        return {
            "name": self.name,
            "title": self.title,
            "value": round(value, self.digits + 1),
            "interval": interval and [round(end, self.digits + 1) for end in interval],
            "target": self.target,
            "bound": None if self.target is None else self.bound,
            "met": self._met(value),
        }

    def _met(self, value: float) -> bool | None:
        if self.target is None:
            return None
        if self.bound == "least":
            return value >= self.target
        return (abs(value) if self.bound == "within" else value) <= self.target


def results(figures: Sequence[Figure], values: Mapping[str, float]) -> list[dict[str, Any]]:
    """Each figure with its value, in order."""
    return [figure.result(values[figure.name]) for figure in figures]


def told_only(told: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The figures without their targets, which are of another size of measurement."""
    return [{**figure, "target": None, "bound": None, "met": None} for figure in told]


def all_met(told: Sequence[Mapping[str, Any]]) -> bool:
    """Whether every figure that has a target reaches it."""
    return all(figure["met"] is not False for figure in told)


def add_rows(table: Table, told: Sequence[Mapping[str, Any]]) -> None:
    """One row for each: title, value, target, verdict."""
    for figure in told:
        value = f"{figure['value']:,.10g}"
        if figure["interval"] is not None:
            low, high = figure["interval"]
            value += f" ({low:+,.10g} to {high:+,.10g})"
        sign = {"least": "≥ ", "most": "≤ ", "within": "± ", None: ""}[figure["bound"]]
        target = "" if figure["target"] is None else f"{sign}{figure['target']:,.10g}"
        verdict = {True: "[green]pass[/]", False: "[red]FAIL[/]", None: ""}[figure["met"]]
        table.add_row(figure["title"], value, target, verdict)
