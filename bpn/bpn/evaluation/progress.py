"""How far trials are, on standard error if that is a terminal."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from bpn.evaluation.trials import OnProgress


@contextmanager
def trials_bar(count: int) -> Iterator[OnProgress]:
    """A bar with the time left while the body runs; what it yields moves it."""
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
        yield lambda over: progress.update(task, completed=over)
