from hypothesis import given
from hypothesis import strategies as st

from bpn_shared.backoff import Backoff


@given(
    first_s=st.floats(0.001, 1.0),
    more_s=st.floats(0.0, 10.0),
    jitter=st.floats(0.0, 1.0),
    tries=st.integers(1, 40),
)
def test_pauses_grow_to_the_longest_and_no_further(
    first_s: float, more_s: float, jitter: float, tries: int
) -> None:
    backoff = Backoff(first_s, first_s + more_s, jitter=jitter)
    for n in range(tries):
        whole_s = min(first_s * 2.0**n, first_s + more_s)
        assert whole_s * (1 - jitter) - 1e-9 <= backoff.next_s() <= whole_s + 1e-9
    backoff.reset()
    assert backoff.next_s() <= first_s


def test_those_who_begin_together_do_not_ask_together() -> None:
    assert len({Backoff().next_s() for _ in range(100)}) > 90
