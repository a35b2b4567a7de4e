"""The connected workers as the place where runs are done, as far as they can be asked before there is a run."""

from collections.abc import Callable

from bpn_shared.config import RunConfig

Probe = Callable[[str], int | None]
"""Lets a robot worker open a Gymnasium environment and tell |A|; None if there is no such worker.

Raises ConfigError if the environment cannot be a task.
"""


class ConnectedWorkers:
    """A `Workplace`: what workers do not tell, such as a GPU, is not known and no reason to refuse a run."""

    def __init__(self, probe: Probe = lambda _task: None) -> None:
        self._probe = probe

    def actions_of(self, task: str) -> int | None:
        """See `Workplace.actions_of`."""
        return self._probe(task)

    def check(self, config: RunConfig) -> None:
        """See `Workplace.check`."""
