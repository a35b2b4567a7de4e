from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_dashboard.registry.states import LOST_AFTER_S, DesiredState, observed
from bpn_shared.runs.folder import State

RECORDED = [state for state in get_args(State) if state not in ("stopping", "lost")]
BEYOND_S = LOST_AFTER_S + 0.1


@pytest.mark.parametrize(
    ("recorded", "desired", "owned", "elsewhere", "unowned_s", "shown"),
    [
        ("queued", "running", False, False, 99.0, "queued"),
        ("queued", "running", True, False, 0.0, "running"),
        ("queued", "stopped", False, False, 99.0, "stopped"),
        ("running", "running", True, False, 0.0, "running"),
        ("running", "running", False, False, LOST_AFTER_S, "running"),
        ("running", "running", False, False, BEYOND_S, "lost"),
        ("running", "stopped", True, False, 0.0, "stopping"),
        ("running", "stopped", False, False, BEYOND_S, "stopped"),
        ("stopped", "running", False, False, BEYOND_S, "queued"),  # its pool was ended, it goes on
        ("stopped", "stopped", False, False, 0.0, "stopped"),
        ("running", "stopped", False, True, BEYOND_S, "running"),  # another program's
        ("finished", "running", True, False, 0.0, "finished"),
        ("failed", "running", False, False, BEYOND_S, "failed"),
    ],
)
def test_what_is_shown(
    recorded: State, desired: DesiredState, owned: bool, elsewhere: bool, unowned_s: float,
    shown: State,
) -> None:  # fmt: skip
    state = observed(recorded, desired, owned=owned, elsewhere=elsewhere, unowned_s=unowned_s)
    assert state == shown


@given(
    recorded=st.sampled_from(RECORDED),
    desired=st.sampled_from(get_args(DesiredState)),
    owned=st.booleans(),
    elsewhere=st.booleans(),
    unowned_s=st.floats(0, 100),
)
def test_a_run_is_shown_as_over_only_if_its_folder_says_so(
    recorded: State, desired: DesiredState, owned: bool, elsewhere: bool, unowned_s: float
) -> None:
    state = observed(recorded, desired, owned=owned, elsewhere=elsewhere, unowned_s=unowned_s)
    assert (state in ("finished", "failed")) == (recorded in ("finished", "failed"))
    if state == "stopping":
        assert owned
        assert desired == "stopped"
    if state == "lost":
        assert not owned
        assert desired == "running"
