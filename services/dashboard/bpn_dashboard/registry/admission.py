"""Whether a run may be worked on, as its folder says now. Reads files: not for who holds a lock."""

from typing import Literal

from bpn_dashboard.registry.leases import Place
from bpn_dashboard.registry.states import OVER
from bpn_shared.config import ConfigError
from bpn_shared.runs.folder import RunFolder, RunState

TAKE_OVER_S = 45.0
"""A learner that was heard of for the last time so long ago, and still owns its run, is dispossessed."""

Verdict = Literal["no", "yes", "take over"]


def recorded(folder: RunFolder) -> RunState | None:
    """What the folder says of its run; None if nothing can be read."""
    try:
        return folder.state()
    except ConfigError:
        return None


def admit(folder: RunFolder, place: Place, *, led: bool, silent: str | None) -> Verdict:
    """Whether somebody may be sent to a vacant place.

    Args:
        led: a worker of ours is the run's learner of rank 0.
        silent: the worker that was, and has been silent for so long that it may be dispossessed.
    """
    state = recorded(folder)
    if state is None or state.state in OVER:
        return "no"
    if place.role != "learner":
        return "yes"
    owner = folder.owner()
    if owner is None or (led and place != place.learner):  # an owner that wants others beside it
        return "yes"
    # Of an owner that never was a worker of ours we know nothing.
    return "take over" if place == place.learner and owner == silent else "no"
