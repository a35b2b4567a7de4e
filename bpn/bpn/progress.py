"""How far something is: bars on standard error, if that is a terminal."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)


def bars(*, speed_estimate_s: float = 30.0) -> Progress:
    """Bars with counts and the time left, gone at their end.

    Args:
        speed_estimate_s: over how long the speed is averaged; more than a few steps take.
    """
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
        disable=not sys.stderr.isatty(),
        speed_estimate_period=speed_estimate_s,
    )


class Bar:
    """One of the bars; called, it moves."""

    def __init__(self, progress: Progress, task: TaskID) -> None:
        self._progress, self._task = progress, task

    def __call__(self, done: int, total: int | None = None) -> None:
        """So many are done, of so many if that is known only now."""
        self._progress.update(self._task, completed=done, total=total)

    def say(self, text: str) -> None:
        """A line on standard error, above the bars where there are any."""
        self._progress.console.print(text, highlight=False, soft_wrap=True, markup=False)


@contextmanager
def bar(what: str, total: int | None = None) -> Iterator[Bar]:
    """A single bar while the body runs, which moves it."""
    with bars() as progress:
        yield Bar(progress, progress.add_task(what, total=total))
