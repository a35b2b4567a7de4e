"""How far trials are, on standard error if that is a terminal."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import NamedTuple

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from bpn.evaluation.trials import OnProgress, Say


class TrialsBar(NamedTuple):
    """What moves the bar, and what prints a line above it: on standard error, bar or not."""

    move: OnProgress
    say: Say


@contextmanager
def trials_bar(count: int) -> Iterator[TrialsBar]:
    """A bar with the time left while the body runs."""
    progress = Progress(
        TextColumn("trials"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
        disable=not sys.stderr.isatty(),
    )
    task = progress.add_task("trials", total=count)
    with progress:
        yield TrialsBar(
            lambda over: progress.update(task, completed=over),
            partial(progress.console.print, highlight=False, soft_wrap=True, markup=False),
        )
