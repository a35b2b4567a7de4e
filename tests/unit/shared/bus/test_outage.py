"""For how long the router has been lost, whatever happens to the one who looks."""

from hypothesis import given
from hypothesis import strategies as st

from bpn_shared.bus.router_watch import STOOD_STILL_S, Outage

LOOKS = st.lists(st.tuples(st.floats(0.0, 100.0), st.booleans()), min_size=1, max_size=30)


@given(LOOKS)
def test_it_is_lost_since_it_was_last_seen_and_all_the_time_in_which_nobody_looked(
    looks: list[tuple[float, bool]],
) -> None:
    outage, t_s, seen_s = Outage(0.0), 0.0, 0.0
    for gap_s, connected in looks:
        before_s, t_s = t_s, t_s + gap_s
        lost_s = outage.look(connected, t_s)
        froze = t_s - before_s > STOOD_STILL_S
        assert outage.stood_still_s == (t_s - before_s if froze else 0.0)
        if connected:
            assert lost_s == outage.stood_still_s
            seen_s = t_s
        else:
            assert lost_s == t_s - seen_s
