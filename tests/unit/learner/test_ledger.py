import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ledgers import ask, make, stopped_soon, stored, wait
from played import CONFIG, episode, owned, played

from bpn_learner import lease
from bpn_learner.ledger import EpisodeLedger
from bpn_shared.counters import Counters
from bpn_shared.messages.base import MessageError, OtherVersionError
from bpn_shared.messages.control import NextEpisode
from bpn_shared.runs.ownership import Ownership
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.seeds import episode_seed
from bpn_shared.waiting import WaitStatus

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
        ledger = EpisodeLedger(config, owner, set(), WaitStatus(), Counters())
        ledger.begin(2)
        told = ledger.next(NextEpisode(slot=0, worker="edge-0"))
    assert (told.policy, told.epsilon) == (policy, pytest.approx(epsilon))


def test_the_lag_of_weights_is_told_of_hand_outs_alone(owner: Ownership) -> None:
    ledger = make(owner, {"edge-0", "edge-1"})

    def ask_with(slot: int, version: int | None) -> str:
        asked = NextEpisode(slot=slot, worker=f"edge-{slot}", weights_version=version)
        return ledger.next(asked).status

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
    monkeypatch.setattr(lease.time, "monotonic", lambda: now_s)
    ledger = make(owner, {"edge-0", "edge-1"}, episodes=1)
    ledger.begin(0)
    assert ask(ledger, 0) == ("play", 0)
    now_s += lease.LEASE_S
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
    assert ledger.receive(played(0, 2)).status == "stored"
    assert owner.folder.episode_path(0, 2).read_bytes() == played(0, 2)
    assert ledger.receive(played(0, 2)).status == "duplicate"
    assert ledger.redelivered == 1
    ledger.begin(1)
    assert ledger.receive(played(0, 2)).status == "duplicate"


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
    assert receipt.status == "refused"
    assert re.search(reason, receipt.reason)
    assert stored(owner) == []
    assert ask(ledger, 0) == ("play", 0)


def test_an_action_that_the_task_does_not_have_is_a_refusal_of_the_episode(
    ledger: EpisodeLedger,
) -> None:
    bad = episode(0, 0)
    bad.actions[:] = 200
    receipt = ledger.receive(bad.encode())
    assert (receipt.status, "action 200" in receipt.reason) == ("refused", True)


def test_an_episode_that_was_terminated_may_be_shorter(ledger: EpisodeLedger) -> None:
    assert ledger.receive(played(0, 0, steps=1, terminated=True)).status == "stored"


def test_rewards_told_by_a_robot_have_to_be_finite_and_its_episodes_may_end_early(
    tmp_path: Path,
) -> None:
    config = RunConfig.for_task(
        "gym:A-v0", actions=14, frames_stacked=1, seed=3, episodes=4, steps=2
    )
    with owned(tmp_path, config) as owner:
        ledger = EpisodeLedger(config, owner, set(), WaitStatus(), Counters())
        ledger.begin(0)
        for odd in (np.nan, np.inf, -np.inf):
            assert "the reward of step 0 is" in ledger.receive(played(0, 0, rewards=odd)).reason
            assert stored(owner) == []
        assert ledger.receive(played(0, 0, rewards=1.0)).status == "stored"
        assert ledger.receive(played(0, 1, steps=1, rewards=1.0)).status == "stored"
        assert ledger.receive(played(0, 2, steps=3, rewards=1.0)).status == "refused"


def test_bytes_of_which_nothing_is_known_are_refused_as_such(ledger: EpisodeLedger) -> None:
    with pytest.raises(MessageError):
        ledger.receive(played(0, 0)[:-7])


def test_an_episode_of_another_version_is_said_to_be_waited_for(owner: Ownership) -> None:
    waiting = WaitStatus()
    ledger = EpisodeLedger(CONFIG, owner, set(), waiting, Counters())
    ledger.begin(0)
    with pytest.raises(OtherVersionError):
        ledger.receive(played(0, 0).replace(b"\xa6schema\x03", b"\xa6schema\x63"))
    with stopped_soon(ledger):
        pass
    assert "schema 99" in (waiting.snapshot()[0] or "")


@pytest.mark.parametrize(("oldest", "attempt", "status"), [
    (0, 1, "stored"), (0, 3, "stored"), (3, 3, "stored"), (3, 2, "refused"), (0, 4, "refused"),
])  # fmt: skip
def test_data_of_an_earlier_attempt_count_if_its_weights_were_the_same(
    owner: Ownership, oldest: int, attempt: int, status: str
) -> None:
    owner.begin_attempt()
    owner.begin_attempt()
    ledger = make(owner)
    ledger.begin(0, oldest_attempt=oldest)
    assert ledger.receive(played(0, 0, weights_attempt=attempt)).status == status
