import contextlib
import errno
import os
import re
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from played import CONFIG, episode, owned, played

from bpn_learner import ledger as ledger_module
from bpn_learner.ledger import EpisodeLedger
from bpn_learner.refusals import ANY_REASON, EpisodeImpossibleError, Refusals
from bpn_learner.storage import StorageError
from bpn_shared.config import RunConfig
from bpn_shared.messages.base import MessageError, OtherVersionError
from bpn_shared.messages.control import Fault, NextEpisode
from bpn_shared.runs.folder import OwnershipLostError
from bpn_shared.runs.ownership import Ownership
from bpn_shared.seeds import episode_seed
from bpn_shared.service import Counters, Waiting


@pytest.fixture
def owner(tmp_path: Path) -> Iterator[Ownership]:
    with owned(tmp_path) as owner:
        yield owner


def make(owner: Ownership, alive: set[str] | None = None, **changes: Any) -> EpisodeLedger:
    config = CONFIG.model_copy(update=changes)
    return EpisodeLedger(config, owner, alive or set(), Waiting(), Counters())


@pytest.fixture
def ledger(owner: Ownership) -> EpisodeLedger:
    """One that collects iteration 0."""
    ledger = make(owner, {"edge-0", "edge-1"})
    ledger.begin(0)
    return ledger


def ask(ledger: EpisodeLedger, slot: int, worker: str | None = None) -> tuple[str, int]:
    assignment = ledger.next(NextEpisode(slot=slot, worker=worker or f"edge-{slot}"))
    return assignment.verdict, assignment.episode


def wait(ledger: EpisodeLedger) -> list[int]:
    """The episodes that were collected."""
    scored = ledger.wait_complete(threading.Event(), lambda _: None)
    assert scored is not None
    return [item.episode.meta.episode for item in scored]


def stored(owner: Ownership) -> list[str]:
    return sorted(path.name for path in (owner.folder.path / "episodes").iterdir())


# What is handed out.


def test_slots_get_different_episodes_with_their_seeds(owner: Ownership) -> None:
    ledger = make(owner, {"edge-0", "edge-1"})
    assert ask(ledger, 0)[0] == "wait"  # nothing is collected yet
    ledger.begin(5)
    assert [ask(ledger, 0), ask(ledger, 1)] == [("play", 0), ("play", 1)]
    assignment = ledger.next(NextEpisode(slot=0, worker="edge-0"))
    assert assignment.seed == episode_seed(CONFIG.seed, 5, 0)
    assert (assignment.weights_attempt, assignment.weights_version) == (1, 5)


@pytest.mark.parametrize(
    ("algorithm", "policy", "epsilon"),
    [("bpn", "softmax", 0.0), ("bqn", "epsilon_greedy", 0.48), ("dqn", "epsilon_greedy", 0.48)],
)
def test_edges_are_told_how_to_choose_actions(
    tmp_path: Path, algorithm: Any, policy: str, epsilon: float
) -> None:
    config = RunConfig.for_task(
        "reaching", algorithm=algorithm, iterations=10, epsilon_initial=0.8, epsilon_final=0.0
    )
    with owned(tmp_path, config) as owner:
        ledger = EpisodeLedger(config, owner, set(), Waiting(), Counters())
        ledger.begin(2)
        told = ledger.next(NextEpisode(slot=0, worker="edge-0"))
    assert (told.policy, told.epsilon) == (policy, pytest.approx(epsilon))


def test_the_lag_of_weights_is_told_of_hand_outs_alone(owner: Ownership) -> None:
    ledger = make(owner, {"edge-0", "edge-1"})

    def ask_with(slot: int, version: int | None) -> str:
        asked = NextEpisode(slot=slot, worker=f"edge-{slot}", weights_version=version)
        return ledger.next(asked).verdict

    assert ask_with(0, 4) == "wait"  # there is no newer version yet
    ledger.begin(5)
    assert ledger.weights_version_lag() == 0.0
    assert [ask_with(0, 3), ask_with(0, 5), ask_with(1, 4), ask_with(1, None)] == ["play"] * 4
    assert ledger.weights_version_lag() == pytest.approx((2 + 0 + 1) / 3)
    ledger.begin(6)
    assert ledger.weights_version_lag() == 0.0


def test_a_slot_that_asks_again_gets_what_it_had(owner: Ownership) -> None:
    ledger = make(owner, {"edge-0", "edge-1", "edge-0b"})
    ledger.begin(0)
    assert ask(ledger, 1) == ("play", 0)
    assert ask(ledger, 0) == ("play", 1)
    assert ask(ledger, 0, "edge-0b") == ("play", 1)  # the slot's edge was restarted


def test_a_dead_edges_episode_is_handed_out_again(owner: Ownership) -> None:
    alive = {"edge-0", "edge-1"}
    ledger = make(owner, alive, episodes=2)
    ledger.begin(0)
    assert [ask(ledger, 0), ask(ledger, 1)] == [("play", 0), ("play", 1)]
    assert ask(ledger, 2, "edge-2")[0] == "wait"
    alive.remove("edge-1")
    assert ask(ledger, 2, "edge-2") == ("play", 1)


def test_an_episode_whose_time_is_over_is_handed_out_again(
    owner: Ownership, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = 100.0
    monkeypatch.setattr(ledger_module.time, "monotonic", lambda: now_s)
    ledger = make(owner, {"edge-0", "edge-1"}, episodes=1)
    ledger.begin(0)
    assert ask(ledger, 0) == ("play", 0)
    now_s += ledger_module.LEASE_S
    assert ask(ledger, 1)[0] == "wait"
    now_s += CONFIG.steps * CONFIG.task_spec.control_period_s + 0.01
    assert ask(ledger, 1) == ("play", 0)


def test_who_played_in_the_iteration_before_holds_nothing_of_the_next(owner: Ownership) -> None:
    ledger = make(owner, {"edge-0", "edge-1"})
    ledger.begin(0)
    assert ask(ledger, 0) == ("play", 0)
    ledger.begin(1)
    assert ask(ledger, 1) == ("play", 0)


# What is delivered.


def test_an_episode_is_on_disk_when_it_is_acknowledged_and_counts_once(
    owner: Ownership, ledger: EpisodeLedger
) -> None:
    assert ledger.receive(played(0, 2)).verdict == "stored"
    assert owner.folder.episode_path(0, 2).read_bytes() == played(0, 2)
    assert ledger.receive(played(0, 2)).verdict == "duplicate"
    assert ledger.redelivered == 1
    ledger.begin(1)
    assert ledger.receive(played(0, 2)).verdict == "duplicate"


@settings(max_examples=30)
@given(order=st.permutations(range(4)), repeats=st.lists(st.integers(0, 3), max_size=4))
def test_any_order_of_deliveries_gives_the_same_data(
    tmp_path_factory: pytest.TempPathFactory, order: list[int], repeats: list[int]
) -> None:
    with owned(tmp_path_factory.mktemp("runs")) as owner:
        ledger = make(owner)
        ledger.begin(0)
        for index in [*repeats, *order]:
            ledger.receive(played(0, index))
        assert wait(ledger) == [0, 1, 2, 3]


REFUSED = [
    (played(1, 0), "iteration 1 has not begun"),
    (played(0, 0, weights_version=3), "played with weights version 3"),
    (played(0, 0, weights_attempt=2), "weights of attempt 2 played it"),
    (played(0, 4), r"episodes 0\.\.3"),
    (played(0, 0, seed=1), "seed 1 is another run's"),
    (played(0, 0, steps=1), "1 steps, an episode of this run has 2"),
    (played(0, 0, steps=3), "3 steps"),
    (played(0, 0, outputs=np.float32), "outputs are float32, bpn has int32"),
    (played(0, 0, black=True), "frame 0 shows no target"),
]


@pytest.mark.parametrize(("data", "reason"), REFUSED)
def test_what_is_no_data_is_refused_with_its_reason_and_handed_out_again(
    owner: Ownership, ledger: EpisodeLedger, data: bytes, reason: str
) -> None:
    assert ask(ledger, 0) == ("play", 0)
    receipt = ledger.receive(data)
    assert receipt.verdict == "refused"
    assert re.search(reason, receipt.reason)
    assert stored(owner) == []
    assert ask(ledger, 0) == ("play", 0)


def test_an_action_that_the_task_does_not_have_is_a_refusal_of_the_episode(
    ledger: EpisodeLedger,
) -> None:
    bad = episode(0, 0)
    bad.actions[:] = 200
    receipt = ledger.receive(bad.encode())
    assert (receipt.verdict, "action 200" in receipt.reason) == ("refused", True)


def test_an_episode_that_was_terminated_may_be_shorter(ledger: EpisodeLedger) -> None:
    assert ledger.receive(played(0, 0, steps=1, terminated=True)).verdict == "stored"


def test_rewards_told_by_a_robot_have_to_be_finite_and_its_episodes_may_end_early(
    tmp_path: Path,
) -> None:
    config = RunConfig.for_task(
        "gym:A-v0", actions=14, frames_stacked=1, seed=3, episodes=4, steps=2
    )
    with owned(tmp_path, config) as owner:
        ledger = EpisodeLedger(config, owner, set(), Waiting(), Counters())
        ledger.begin(0)
        for odd in (np.nan, np.inf, -np.inf):
            assert "the reward of step 0 is" in ledger.receive(played(0, 0, rewards=odd)).reason
            assert stored(owner) == []
        assert ledger.receive(played(0, 0, rewards=1.0)).verdict == "stored"
        assert ledger.receive(played(0, 1, steps=1, rewards=1.0)).verdict == "stored"
        assert ledger.receive(played(0, 2, steps=3, rewards=1.0)).verdict == "refused"


def test_bytes_of_which_nothing_is_known_are_refused_as_such(ledger: EpisodeLedger) -> None:
    with pytest.raises(MessageError):
        ledger.receive(played(0, 0)[:-7])


def test_an_episode_of_another_version_is_said_to_be_waited_for(owner: Ownership) -> None:
    waiting = Waiting()
    ledger = EpisodeLedger(CONFIG, owner, set(), waiting, Counters())
    ledger.begin(0)
    with pytest.raises(OtherVersionError):
        ledger.receive(played(0, 0).replace(b"\xa6schema\x03", b"\xa6schema\x63"))
    with stopped_soon(ledger):
        pass
    assert "schema 99" in (waiting.snapshot()[0] or "")


@pytest.mark.parametrize(("oldest", "attempt", "verdict"), [
    (0, 1, "stored"), (0, 3, "stored"), (3, 3, "stored"), (3, 2, "refused"), (0, 4, "refused"),
])  # fmt: skip
def test_data_of_an_earlier_attempt_count_if_its_weights_were_the_same(
    owner: Ownership, oldest: int, attempt: int, verdict: str
) -> None:
    owner.begin_attempt()
    owner.begin_attempt()
    ledger = make(owner)
    ledger.begin(0, oldest_attempt=oldest)
    assert ledger.receive(played(0, 0, weights_attempt=attempt)).verdict == verdict


# What cannot be had.


def impossible(ledger: EpisodeLedger) -> str:
    with pytest.raises(EpisodeImpossibleError) as raised:
        wait(ledger)
    return str(raised.value)


def test_the_same_refusal_three_times_in_a_row_ends_the_run(ledger: EpisodeLedger) -> None:
    for data in (played(0, 1, black=True), played(0, 2, black=True)) * 2:
        ledger.receive(data)
    ledger.receive(played(0, 1, steps=1))  # another reason: counts anew
    ledger.receive(played(0, 1, black=True))
    with stopped_soon(ledger):
        pass
    ledger.receive(played(0, 2, black=True))
    said = impossible(ledger)
    assert said.startswith("episode (0, 2) cannot be had: frame 0 shows no target")
    assert said.endswith("(3 times in a row)")


def test_the_same_fault_told_three_times_ends_the_run(ledger: EpisodeLedger) -> None:
    def tell(iteration: int, index: int) -> None:
        ledger.fault(
            Fault(iteration=iteration, episode=index, worker="edge-0", reason="it raises Boom")
        )

    for which in ((0, 0), (0, 0), (1, 0), (0, 1), (0, 9)):
        tell(*which)
    with stopped_soon(ledger):
        pass
    tell(0, 0)
    assert "(0, 0) cannot be had: it raises Boom (3 times in a row)" in impossible(ledger)


def test_what_is_stored_or_over_cannot_become_impossible(ledger: EpisodeLedger) -> None:
    ledger.receive(played(0, 0))
    for _ in range(5):
        ledger.fault(Fault(iteration=0, episode=0, worker="edge-0", reason="too late"))
        ledger.receive(played(1, 0, black=True))
        ledger.receive(played(0, 1, weights_attempt=7))
    for index in (1, 2, 3):
        ledger.receive(played(0, index))
    assert wait(ledger) == [0, 1, 2, 3]
    for _ in range(5):
        ledger.fault(Fault(iteration=0, episode=1, worker="edge-0", reason="too late"))
    ledger.begin(1)
    with stopped_soon(ledger):
        pass


def test_reasons_that_change_have_an_end_too() -> None:
    refusals = Refusals(4)
    said = [refusals.add(2, f"reason {count}") for count in range(ANY_REASON)]
    assert said[:-1] == [None] * (ANY_REASON - 1)
    assert f"the last of {ANY_REASON} refusals" in str(said[-1])


def test_refusals_are_logged_at_the_first_tenth_and_hundredth(
    ledger: EpisodeLedger, caplog: pytest.LogCaptureFixture
) -> None:
    for _ in range(120):
        ledger.receive(played(1, 0))
    assert len([m for m in caplog.messages if "refused" in m]) == 3


# The disk.


def failing(monkeypatch: pytest.MonkeyPatch, owner: Ownership, number: int) -> None:
    def refuse(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(owner, "write_episode", refuse)


@pytest.mark.parametrize(("number", "reason"), [
    (errno.ENOSPC, r"room on the disk: cannot write episode \(0, 1\): No space left"),
    (errno.EACCES, r"help with the disk: cannot write episode \(0, 1\): Permission denied"),
    (errno.EIO, "help with the disk: .*: Input/output error"),
])  # fmt: skip
def test_what_cannot_be_kept_is_not_acknowledged_and_delivered_again(
    owner: Ownership, number: int, reason: str
) -> None:
    waiting = Waiting()
    ledger = EpisodeLedger(CONFIG, owner, set(), waiting, Counters())
    ledger.begin(0)
    with pytest.MonkeyPatch.context() as monkeypatch:
        failing(monkeypatch, owner, number)
        for _ in range(2):
            with pytest.raises(StorageError, match=reason):
                ledger.receive(played(0, 1))
        with stopped_soon(ledger):
            pass
        assert re.search(reason, waiting.snapshot()[0] or "")
        assert stored(owner) == []
    assert ledger.receive(played(0, 1)).verdict == "stored"  # by itself, once there is room
    with stopped_soon(ledger):
        pass
    assert waiting.snapshot()[0] == "4 episodes of iteration 0"


def test_a_learner_that_another_has_replaced_takes_nothing_and_gives_up(owner: Ownership) -> None:
    ledger = make(owner)
    ledger.begin(0)
    with ledger_of_another(owner):
        with pytest.raises(StorageError, match="attempt 2"):
            ledger.receive(played(0, 1))
        with pytest.raises(OwnershipLostError):
            wait(ledger)
    assert stored(owner) == []


def test_a_learner_that_hears_nothing_sees_by_itself_that_it_was_replaced(
    owner: Ownership, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ledger_module, "PROVE_S", 0.0)
    ledger = make(owner)
    ledger.begin(0)
    with ledger_of_another(owner), pytest.raises(OwnershipLostError):
        wait(ledger)


@contextlib.contextmanager
def ledger_of_another(owner: Ownership) -> Iterator[None]:
    (owner.folder.path / ".lock").unlink()
    with owner.folder.owned("learner-2") as other:
        other.begin_attempt()
        yield


# Restarts and ends.


def test_a_restarted_learner_takes_up_what_is_on_disk(owner: Ownership) -> None:
    first = make(owner, {"edge-0"})
    first.begin(0)
    for index in (0, 1, 3):
        first.receive(played(0, index))
    owner.folder.episode_path(0, 1).write_bytes(b"damaged by a full disk")
    owner.begin_attempt()
    second = make(owner, {"edge-0"})
    second.begin(0)
    assert ask(second, 0) == ("play", 1)
    assert second.receive(played(0, 0)).verdict == "duplicate"
    assert second.receive(played(0, 1)).verdict == "stored"
    assert stored(owner) == [
        "000000-00000.bpne", "000000-00001.bpne", "000000-00001.damaged-1", "000000-00003.bpne",
    ]  # fmt: skip


@contextlib.contextmanager
def stopped_soon(ledger: EpisodeLedger) -> Iterator[None]:
    """Waits as training does, and is stopped while it does; nothing was completed, nothing failed."""
    stop, began = threading.Event(), threading.Event()
    result: list[object] = []

    def collect() -> None:
        try:
            result.append(ledger.wait_complete(stop, lambda _: began.set()))
        except Exception as error:
            result.append(error)

    thread = threading.Thread(target=collect)
    thread.start()
    try:
        assert began.wait(10)
        yield
    finally:
        stop.set()
        thread.join(10)
    assert not thread.is_alive(), "a learner without episodes ignores that it is stopped"
    assert result == [None]


def test_a_learner_stops_while_it_waits(ledger: EpisodeLedger) -> None:
    with stopped_soon(ledger):
        pass


def test_a_learner_that_was_stopped_before_does_not_wait(ledger: EpisodeLedger) -> None:
    stop = threading.Event()
    stop.set()
    assert ledger.wait_complete(stop, lambda _: None) is None


def test_progress_is_told_as_episodes_come(
    ledger: EpisodeLedger, wait_for: Callable[..., None]
) -> None:
    counts: list[int] = []
    thread = threading.Thread(
        target=lambda: ledger.wait_complete(threading.Event(), counts.append), daemon=True
    )
    thread.start()
    for index in range(4):
        wait_for(lambda count=index: counts[-1:] == [count], f"{index} episodes to be told")
        ledger.receive(played(0, index))
    thread.join(10)
    assert counts == [0, 1, 2, 3]


def test_during_the_update_edges_are_told_so(ledger: EpisodeLedger) -> None:
    for index in range(4):
        ledger.receive(played(0, index))
    wait(ledger)
    told = ledger.next(NextEpisode(slot=0, worker="edge-0"))
    assert (told.verdict, told.reason) == ("wait", "the policy update")


def test_who_has_no_episode_left_is_told_what_it_waits_for(ledger: EpisodeLedger) -> None:
    for index in range(3):
        ledger.receive(played(0, index))
    assert ask(ledger, 0) == ("play", 3)
    told = ledger.next(NextEpisode(slot=1, worker="edge-1"))
    assert (told.verdict, told.reason) == ("wait", "the other robots' episodes")


def test_after_the_last_iteration_edges_are_told_so(ledger: EpisodeLedger) -> None:
    ledger.finish()
    assert ask(ledger, 0)[0] == "finished"


def test_the_end_is_waited_for_until_every_slot_that_played_knows_it(
    ledger: EpisodeLedger,
) -> None:
    ask(ledger, 0)
    ask(ledger, 1)
    ledger.finish()
    thread = threading.Thread(target=ledger.wait_told, args=(threading.Event(), 60.0), daemon=True)
    thread.start()
    assert ask(ledger, 0)[0] == "finished"
    assert thread.is_alive()
    assert ask(ledger, 1)[0] == "finished"
    thread.join(10)
    assert not thread.is_alive()
