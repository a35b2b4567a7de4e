"""An edge delivers one episode while it plays the next: what it has in hand is neither lost nor played twice."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ledgers import make, wait
from played import CONFIG, owned, played

from bpn_learner.ledger import EpisodeLedger
from bpn_shared.messages.control import Assignment, NextEpisode
from bpn_shared.runs.ownership import Ownership


def ask(
    ledger: EpisodeLedger, slot: int = 0, in_hand: tuple[int, int] | None = None
) -> tuple[str, int]:
    told = ledger.next(NextEpisode(slot=slot, worker=f"edge-{slot}", in_hand=in_hand))
    return told.status, told.episode


def test_what_is_in_hand_is_given_to_nobody_until_its_slot_has_lost_it(owner: Ownership) -> None:
    ledger = make(owner, {"edge-0", "edge-1"}, episodes=3)
    ledger.begin(0)
    assert ask(ledger, 0) == ("play", 0)
    assert ask(ledger, 0, in_hand=(0, 0)) == ("play", 1)
    assert ask(ledger, 1) == ("play", 2)
    assert ask(ledger, 1, in_hand=(0, 2))[0] == "wait"  # everything is played or being played
    assert ask(ledger, 0) == ("play", 0)  # its edge was restarted and has neither


def test_a_learner_that_was_restarted_learns_what_is_in_hand(owner: Ownership) -> None:
    ledger = make(owner, {"edge-0", "edge-1"})
    ledger.begin(0)
    assert ask(ledger, 0, in_hand=(0, 0)) == ("play", 1)
    assert ask(ledger, 1) == ("play", 2)


@pytest.mark.parametrize("in_hand", [(1, 0), (7, 1), (2, 400)])
def test_what_is_in_hand_of_another_iteration_does_not_matter(
    owner: Ownership, in_hand: tuple[int, int]
) -> None:
    ledger = make(owner, {"edge-0"})
    ledger.begin(2)
    assert ask(ledger, 0, in_hand=in_hand) == ("play", 0)


class Edge:
    """Plays at once, has at most one episode in hand, and may lose what it has."""

    def __init__(self, ledger: EpisodeLedger, slot: int) -> None:
        self._ledger, self.slot = ledger, slot
        self.playing: Assignment | None = None
        self.in_hand: Assignment | None = None

    def ask(self) -> None:
        hand = self.in_hand
        asked = NextEpisode(
            slot=self.slot,
            worker=f"edge-{self.slot}",
            in_hand=(hand.iteration, hand.episode) if hand else None,
        )
        told = self._ledger.next(asked)
        if told.status != "play":
            self.deliver()
        else:
            assert told != hand, "it is given what it has in hand"
            self.playing = told

    def deliver(self) -> None:
        if self.in_hand is not None:
            data = played(self.in_hand.iteration, self.in_hand.episode, slot=self.slot)
            assert self._ledger.receive(data).status != "refused"
        self.in_hand = None

    def step(self, what: str) -> None:
        if what == "die":
            self.playing = self.in_hand = None
        elif what == "deliver":
            self.deliver()
        elif self.playing is None:
            self.ask()
        elif self.in_hand is None:
            self.in_hand, self.playing = self.playing, None
        else:
            self.deliver()


@given(
    st.lists(
        st.tuples(st.integers(0, 1), st.sampled_from(["go", "go", "go", "deliver", "die"])),
        max_size=40,
    )
)
@settings(deadline=None, max_examples=40)
def test_in_whatever_order_edges_ask_deliver_and_die_every_episode_is_collected(
    tmp_path_factory: pytest.TempPathFactory, steps: list[tuple[int, str]]
) -> None:
    path: Path = tmp_path_factory.mktemp("runs")
    with owned(path) as owner:
        ledger = make(owner, {"edge-0", "edge-1"})
        ledger.begin(0)
        edges = [Edge(ledger, slot) for slot in (0, 1)]
        for slot, what in steps:
            edges[slot].step(what)
        for _ in range(3 * CONFIG.episodes):  # of an edge alone: ask, play, deliver
            for edge in edges:
                edge.step("go")
        assert wait(ledger) == list(range(CONFIG.episodes))
        if not any(what == "die" for _, what in steps):
            assert ledger.redelivered == 0, "an episode was played twice"
