"""Episodes that cannot be had or kept, learners that are replaced, stopped or at their end."""

import contextlib
import errno
import os
import re
import threading
from collections.abc import Callable, Iterator

import pytest
from ledgers import ask, make, stopped_soon, stored, wait
from played import CONFIG, played

from bpn_learner import ledger as ledger_module
from bpn_learner.ledger import EpisodeLedger
from bpn_learner.refusals import ANY_REASON, EpisodeImpossibleError, EpisodeRefusals
from bpn_learner.storage import StorageError
from bpn_shared.counters import Counters
from bpn_shared.messages.control import Fault, NextEpisode
from bpn_shared.runs.folder import OwnershipLostError
from bpn_shared.runs.ownership import Ownership
from bpn_shared.waiting import WaitStatus

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
    refusals = EpisodeRefusals()
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
    waiting = WaitStatus()
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
    assert ledger.receive(played(0, 1)).status == "stored"  # by itself, once there is room
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
    assert second.receive(played(0, 0)).status == "duplicate"
    assert second.receive(played(0, 1)).status == "stored"
    assert stored(owner) == [
        "000000-00000.bpne", "000000-00001.bpne", "000000-00001.damaged-1", "000000-00003.bpne",
    ]  # fmt: skip


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
    assert (told.status, told.reason) == ("wait", "the policy update")


def test_who_has_no_episode_left_is_told_what_it_waits_for(ledger: EpisodeLedger) -> None:
    for index in range(3):
        ledger.receive(played(0, index))
    assert ask(ledger, 0) == ("play", 3)
    told = ledger.next(NextEpisode(slot=1, worker="edge-1"))
    assert (told.status, told.reason) == ("wait", "the other robots' episodes")


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
