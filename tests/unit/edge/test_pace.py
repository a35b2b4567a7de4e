import itertools

from hypothesis import given
from hypothesis import strategies as st

from bpn_edge.learner_link import LATEST_S, SOONEST_S, Pace


@given(st.integers(0, 40), st.integers(1, 40))
def test_pauses_grow_to_a_bound_and_begin_anew_with_news(before: int, after: int) -> None:
    pace = Pace()
    for _ in range(before):
        pace.next_pause_s()
    pace.reset()
    pauses_s = [pace.next_pause_s() for _ in range(after)]
    assert pauses_s[0] == SOONEST_S
    assert all(one <= two <= 2 * one for one, two in itertools.pairwise(pauses_s))
    assert max(pauses_s) <= LATEST_S


def test_an_update_of_seconds_is_asked_about_a_few_times() -> None:
    pace, elapsed_s, asked = Pace(), 0.0, 0
    while elapsed_s < 6.0:
        elapsed_s, asked = elapsed_s + pace.next_pause_s(), asked + 1
    assert asked < 20
