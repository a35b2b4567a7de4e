"""Whether a run may be worked on, as its folder says now. Reads files: not for who holds a lock."""

from bpn_dashboard.registry.leases import Place
from bpn_shared.runs.folder import RunFolder, RunState
from bpn_shared.runs.state import OVER
from bpn_shared.spec.config import ConfigError


def recorded(folder: RunFolder) -> RunState | None:
    """What the folder says of its run; None if nothing can be read."""
    try:
        return folder.state()
    except ConfigError:
        return None


def admits(folder: RunFolder, place: Place, *, led: bool) -> bool:
    """Whether somebody may be sent to a vacant place.

    Args:
        led: a worker of ours is the run's learner of rank 0.
    """
    state = recorded(folder)
    if state is None or state.state in OVER:
        return False
    if place.role != "learner":
        return True
    try:
        owned = folder.is_owned()
    except ConfigError:
        return False
    # Its owner is a worker of ours that wants others beside it, or else somebody of whom we know nothing.
    return not owned or (led and place != place.learner)
