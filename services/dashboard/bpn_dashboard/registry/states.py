"""The rules about a run's state. What its folder records, what is wanted, and who is there make what is shown.

The folder records queued, running, finished, failed or stopped. `stopping` and `lost` are never recorded:
they say that what is recorded and what is wanted or there do not agree yet.
"""

from typing import Literal

from bpn_shared.runs.state import OVER, State

DesiredState = Literal["running", "stopped"]

BUSY: tuple[State, ...] = ("running", "stopping", "lost")
"""In which something may be working on a run."""
LOST_AFTER_S = 5.0
"""How long a running run may be without a learner, as between one that died and the next."""


def observed(
    recorded: State,
    desired: DesiredState,
    *,
    owned: bool,
    elsewhere: bool = False,
    unowned_s: float = 0.0,
) -> State:
    """The state to show.

    Args:
        recorded: what the run folder says.
        owned: a learner that the registry knows works on it now.
        elsewhere: one that it does not know does (`bpn train` without a dashboard): it cannot be stopped.
        unowned_s: for how long no learner has worked on it.
    """
    if recorded in OVER:
        return recorded
    if owned:
        return "running" if desired == "running" else "stopping"
    if elsewhere:
        return "running"
    if desired == "stopped":
        return "stopped"
    if recorded != "running":
        return "queued"
    return "lost" if unowned_s > LOST_AFTER_S else "running"


def is_busy(state: State | str) -> bool:
    """Whether something may be working on a run that is shown in this state."""
    return state in BUSY


def is_idle(state: State | str) -> bool:
    """Whether nobody works on a run that is shown in this state, nor will by itself."""
    return state != "queued" and not is_busy(state)
