from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_shared.messages.telemetry import Telemetry
from bpn_shared.runtime.watchdog import (
    CAUSE_KINDS,
    SILENT_AFTER_S,
    STALLED_AFTER_S,
    Circumstances,
    Watchdog,
    sentence,
)

STEPS = 20
NOWHERE = Circumstances()
AT_NS = 1_764_266_600 * 10**9  # 18:03:20 UTC


def report(worker: str, kind: str = "learner", **more: Any) -> Telemetry:
    values: dict[str, Any] = {
        "kind": kind, "worker": worker, "run": "00000000-0000-0000-0000-000000000001", "slot": 0,
        "host": "h", "clock": "c", "pid": 1, "time_ns": AT_NS, "uptime_s": 1.0, "waiting_for": None,
        "waiting_s": 0.0, "cpu_percent": 0.0, "rss_bytes": 0, "counters": {}, "weights": {},
        "latencies": {}, "traffic": [],
    }  # fmt: skip
    return Telemetry(**(values | more))


def said(dog: Watchdog, now_s: float, around: Circumstances) -> str:
    return sentence(dog.causes(now_s, around))


@pytest.fixture
def dog() -> Watchdog:
    return Watchdog(STEPS, 0.0)


@pytest.mark.parametrize("counter", ["episodes_stored", "epochs_done"])
def test_what_the_learner_gets_done_is_progress(dog: Watchdog, counter: str) -> None:
    for second in range(100):
        dog.hear(report("learner-1", counters={counter: second // 20}), float(second))
        assert dog.stall(float(second), NOWHERE) is None
    for second in range(100, 140):
        dog.hear(report("learner-1", counters={counter: 4}), float(second))
    stall = dog.stall(139.0, NOWHERE)
    assert stall is not None
    assert stall.for_s == 139.0 - 80.0
    dog.iterated(1, 140.0)
    assert dog.stall(140.0, NOWHERE) is None
    dog.iterated(1, 180.0)  # the same again is none
    assert dog.stall(180.0, NOWHERE) is not None


@given(steps=st.lists(st.integers(0, 30), min_size=60, max_size=90))
def test_an_edge_that_plays_without_end_brings_nobody_on(steps: list[int]) -> None:
    """Oracle: steps are progress as long as fewer than two episodes' were played since the learner's last."""
    dog, total, last_s = Watchdog(STEPS, 0.0), 0, 0.0
    for second, played in enumerate(steps):
        if played and second and total - steps[0] < 2 * STEPS:
            last_s = float(second)
        total += played
        dog.hear(report("edge-1", "edge", counters={"steps_played": total}), float(second))
    now_s = float(len(steps) - 1)
    stall = dog.stall(now_s, NOWHERE)
    assert (stall is None) == (now_s - last_s < STALLED_AFTER_S)
    if stall is not None:
        assert stall.for_s == now_s - last_s
    dog.hear(report("learner-1", counters={"episodes_stored": 1}), now_s)
    dog.hear(report("learner-1", counters={"episodes_stored": 2}), now_s)
    dog.hear(report("edge-1", "edge", counters={"steps_played": total + 1}), now_s + 1)
    assert dog.stall(now_s + STALLED_AFTER_S, NOWHERE) is None  # and it counts again


def test_what_a_worker_did_in_other_runs_is_no_progress_here(dog: Watchdog) -> None:
    for second in range(0, 40, 10):
        worker = f"learner-{second}"
        dog.hear(report(worker, counters={"episodes_stored": 100 + second}), float(second))
    assert dog.stall(35.0, NOWHERE) is not None


def test_a_frozen_owner_is_named_with_the_time_of_its_last_word(dog: Watchdog) -> None:
    dog.hear(report("learner-1"), 0.0)
    edge = report("edge-1", "edge", waiting_for="the learner to take the episode")
    for second in range(40):
        dog.hear(edge, float(second))
    at_30, at_39 = (dog.stall(t, NOWHERE) for t in (30.0, 39.0))
    assert at_30 is not None
    assert at_39 is not None
    assert (
        at_30.reason
        == at_39.reason
        == (
            "its owner learner-1 is silent since 18:03:20 UTC; edge 0 waits for the learner to take the episode"
        )
    )


def test_another_learner_takes_the_silent_ones_place(dog: Watchdog) -> None:
    dog.hear(report("learner-1"), 0.0)
    dog.hear(report("learner-2", waiting_for="3 episodes of iteration 0"), 50.0)
    assert said(dog, 51.0, NOWHERE) == "the learner waits for 3 episodes of iteration 0"


def test_reasons_come_in_the_order_in_which_they_can_be_mended(dog: Watchdog) -> None:
    around = Circumstances(
        queue="2 runs before it", lacking=("1 edge missing: 0 connected and idle",),
        refused=("edge edge-12 speaks protocol 1",), disk="the disk is full",
    )  # fmt: skip
    assert (
        said(dog, 0.0, around)
        == "2 runs before it; edge edge-12 speaks protocol 1; the disk is full"
    )
    held = Circumstances(queue="2 runs before it", owner="its folder is held by x")
    assert said(dog, 0.0, held) == "its folder is held by x"
    dog.hear(report("learner-1", waiting_for="episodes"), 0.0)
    assert said(dog, 0.0, Circumstances(lacking=around.lacking, refused=around.refused)) == (
        "the learner waits for episodes; 1 edge missing: 0 connected and idle; edge edge-12 speaks protocol 1"
    )
    assert said(dog, 0.0, Circumstances(router="the router is away", disk="full")) == (
        "the router is away"
    )


@given(waiting=st.integers(0, 9), refused=st.integers(0, 5))
def test_however_much_waits_the_causes_beside_it_are_told(waiting: int, refused: int) -> None:
    dog = Watchdog(STEPS, 0.0)
    for slot in range(waiting):
        dog.hear(report(f"edge-{slot}", "edge", slot=slot, waiting_for="a frame"), 0.0)
    foreign = tuple(f"edge edge-{n} speaks protocol 1" for n in range(refused))
    reason = said(dog, 0.0, Circumstances(refused=foreign, disk="the disk is full"))
    assert reason.endswith("the disk is full")
    assert ("speaks protocol 1" in reason) == (refused > 0)
    assert len(reason.split("; ")) <= 7


def test_what_was_refused_since_the_last_progress_is_said_and_older_things_are_not(
    dog: Watchdog,
) -> None:
    def refusing(count: int, **counters: int) -> Telemetry:
        return report(
            "learner-1", counters={"episodes_refused": count, **counters},
            refusals={"episodes_refused": "reward is NaN"},
        )  # fmt: skip

    dog.hear(refusing(3), 0.0)
    assert said(dog, 0.0, NOWHERE) == "its learner computes"
    dog.hear(refusing(4), 1.0)
    assert said(dog, 1.0, NOWHERE) == "the learner refused: reward is NaN"
    dog.hear(refusing(4, episodes_stored=1), 2.0)
    assert said(dog, 2.0, NOWHERE) == "its learner computes"


def test_every_cause_has_a_kind_that_can_be_counted(dog: Watchdog) -> None:
    def kinds(now_s: float, **around: Any) -> list[str]:
        return [cause.kind for cause in dog.causes(now_s, Circumstances(**around))]

    seen = [
        kinds(0.0),
        kinds(0.0, router="away"),
        kinds(0.0, owner="held"),
        kinds(0.0, queue="long"),
    ]
    seen.append(kinds(0.0, refused=("an old edge",), disk="full"))
    dog.hear(report("learner-1"), 0.0)
    seen += [kinds(0.0), kinds(0.0, lacking=("1 edge",))]
    refused = {"counters": {"frames_refused": 1}, "refusals": {"frames_refused": "too long"}}
    dog.hear(report("learner-1", waiting_for="episodes", **refused), 1.0)
    seen += [kinds(1.0), kinds(2.0 + SILENT_AFTER_S)]
    assert seen == [
        ["nobody"], ["router"], ["owner"], ["queue"], ["worker", "disk"],
        ["computing"], ["place"], ["service", "refusal"], ["silent"],
    ]  # fmt: skip
    assert {kind for kinds_ in seen for kind in kinds_} | {"nobody"} == set(CAUSE_KINDS)


def test_who_left_and_who_is_no_worker_says_nothing(dog: Watchdog) -> None:
    dog.hear(report("dashboard-1", "dashboard", waiting_for="nothing"), 0.0)
    dog.hear(report("robot-sim-1", "robot_sim", waiting_for="a reset", slot=2), 0.0)
    assert said(dog, 0.0, NOWHERE) == "robot 2 waits for a reset"
    assert dog.silent_s("robot-sim-1", SILENT_AFTER_S) == SILENT_AFTER_S
    dog.gone("robot-sim-1")
    assert said(dog, 0.0, NOWHERE) == "nobody reports from it"
    assert dog.silent_s("robot-sim-1", 1.0) is None


def test_a_run_that_is_wanted_anew_has_its_time_again(dog: Watchdog) -> None:
    assert dog.stall(STALLED_AFTER_S, NOWHERE) is not None
    dog.begin(STALLED_AFTER_S)
    assert dog.stall(STALLED_AFTER_S + 1, NOWHERE) is None
