from uuid import UUID

from hypothesis import given
from hypothesis import strategies as st

from bpn_dashboard.registry.leases import Place
from bpn_dashboard.registry.losses import SURELY_DEAD_S, Losses
from bpn_dashboard.registry.setbacks import (
    DEATHS,
    GIVE_BACKS,
    GIVE_BACKS_AT_MOST,
    GiveBack,
    Setbacks,
)

A, B = UUID(int=1), UUID(int=2)
EDGE = Place(A, "edge", 0)


def longest_row(iterations: list[int]) -> int:
    """How many equal ones there are in a row at most."""
    longest = row = 0
    for index, iteration in enumerate(iterations):
        row = row + 1 if index and iterations[index - 1] == iteration else 1
        longest = max(longest, row)
    return longest


@given(st.lists(st.integers(0, 2), max_size=20))
def test_a_run_is_given_up_after_deaths_in_a_row_within_one_iteration(gains: list[int]) -> None:
    setbacks, iterations = Setbacks(), [sum(gains[: n + 1]) for n in range(len(gains))]
    for other, iteration in enumerate(iterations):
        assert setbacks.died(B, "learner-0", other) is None  # another run, which gets on
        reason = setbacks.died(A, f"learner-{other}", iteration)
        given_up = longest_row(iterations[: other + 1]) >= DEATHS
        if reason is not None:
            assert given_up
            assert (
                f"learners in a row died in iteration {iteration}, the last was learner-" in reason
            )
            setbacks.forget(A)
            assert setbacks.died(A, "learner-x", iteration) is None  # resumed, it begins anew
            return
    assert longest_row(iterations) < DEATHS


def back(worker: str, iteration: int = 0) -> GiveBack:
    return GiveBack(EDGE, worker, "no ONNX Runtime", iteration)


def test_a_place_that_all_idle_workers_give_back_is_given_up_with_their_reason() -> None:
    setbacks = Setbacks()
    reasons = [setbacks.gave_back(back("edge-1"), {"edge-1"}, float(t)) for t in range(GIVE_BACKS)]
    assert reasons[:-1] == [None] * (GIVE_BACKS - 1)
    assert reasons[-1] is not None
    assert reasons[-1].startswith(
        "edge 0 of the run was given back 3 times in a row in iteration 0"
    )
    assert "the last time by edge-1: no ONNX Runtime" in reasons[-1]


def test_one_that_has_not_tried_yet_tries_first_but_not_for_ever() -> None:
    setbacks, idle = Setbacks(), {"edge-1", "edge-2", "edge-able"}
    for attempt in range(1, GIVE_BACKS_AT_MOST):
        assert setbacks.gave_back(back(f"edge-{attempt % 2}"), idle, 0.0) is None
    assert setbacks.gave_back(back("edge-1"), idle, 0.0) is not None


def test_progress_and_long_service_end_a_row_of_give_backs() -> None:
    setbacks = Setbacks()
    for iteration in range(3 * GIVE_BACKS):
        assert setbacks.gave_back(back("edge-1", iteration), {"edge-1"}, 0.0) is None
    for _ in range(3 * GIVE_BACKS):
        assert setbacks.gave_back(back("edge-1"), {"edge-1"}, 0.0) is None
        setbacks.served(EDGE)


def test_the_same_place_is_offered_to_who_gave_it_back_after_pauses_that_grow() -> None:
    setbacks, now_s, pauses = Setbacks(), 0.0, []
    for _ in range(8):
        setbacks.gave_back(back("edge-1"), set(), now_s)
        assert setbacks.may_try(EDGE, "edge-2", now_s)
        assert setbacks.may_try(Place(B, "edge", 0), "edge-1", now_s)
        begin_s = now_s
        while not setbacks.may_try(EDGE, "edge-1", now_s):
            now_s += 0.5
        pauses.append(now_s - begin_s)
    assert pauses == [2.0, 4.0, 8.0, 16.0, 32.0, 60.0, 60.0, 60.0]
    assert setbacks.newest(EDGE) == "edge-1 gave it back: no ONNX Runtime"
    assert setbacks.newest(Place(B, "edge", 0)) == ""


def test_how_far_a_run_had_come_is_noted_once_and_judged_later() -> None:
    losses = Losses()
    losses.lost(A, "learner-1", 0.0)
    assert losses.is_unnoted(A)
    assert not losses.is_unnoted(B)
    assert losses.deaths(100.0, set()) == []  # nothing is judged of which is not known when it was
    (loss,) = losses.unnoted()
    loss.iteration = 3
    assert not losses.is_unnoted(A)
    assert losses.deaths(SURELY_DEAD_S, set()) == []  # it may still ask for work
    (death,) = losses.deaths(SURELY_DEAD_S + 0.1, {"learner-2"})
    assert (death.worker, death.iteration) == ("learner-1", 3)
    assert losses.deaths(200.0, set()) == []  # told once


def test_who_lives_or_asks_again_has_not_died() -> None:
    losses = Losses()
    for worker in ("learner-asks", "learner-lives", "learner-finished"):
        losses.lost(A, worker, 0.0)
    losses.heard_of("learner-asks")
    for loss in losses.unnoted():
        loss.iteration = 0
        if loss.worker == "learner-finished":
            losses.drop(loss)
    assert losses.deaths(10.0, {"learner-lives"}) == []


def test_nobody_died_because_the_router_did() -> None:
    losses = Losses()
    losses.lost(A, "learner-1", 0.0)
    losses.clear()
    assert not losses.is_unnoted(A)
    assert losses.deaths(10.0, set()) == []
