"""How the learners of one run meet for an update, over a real router and real connections."""

import contextlib
import threading
from collections.abc import Callable, Iterator
from uuid import UUID

import pytest
import torch

from bpn_learner import rendezvous
from bpn_learner.group import DistributedGroup, GroupLostError
from bpn_learner.rendezvous import Rendezvous, join
from bpn_learner.update import UpdateStopped
from bpn_shared.bus import keys
from bpn_shared.bus.requests import RefusedError, request
from bpn_shared.bus.session import Bus
from bpn_shared.messages.rendezvous import RendezvousReply, RendezvousRequest
from bpn_shared.runtime.worker import Worker
from bpn_shared.spec.config import RunConfig

RUN = UUID(int=5)
CONFIG = RunConfig.for_task("reaching", learners=3)
WaitFor = Callable[..., None]


@pytest.fixture
def worker_of(open_bus: Callable[[], Bus]) -> Callable[[int], Worker]:
    """A learner's process as its work sees it."""

    def make(rank: int) -> Worker:
        stop = threading.Event()
        return Worker(
            kind="learner", id=f"learner-{rank}", bus=open_bus(), stop=stop, run=RUN, slot=rank
        )

    return make


def ask(worker: Worker, rank: int | None = None) -> RendezvousReply:
    asked = RendezvousRequest(rank=worker.slot if rank is None else rank, worker=worker.id)
    answer = request(worker.bus, keys.rendezvous(RUN), asked.encode(), timeout_s=10.0)
    return RendezvousReply.decode(answer)


class First(threading.Thread):
    """Rank 0's update: gathers the others, and leaves the group when it is told to."""

    def __init__(self, worker: Worker) -> None:
        super().__init__()
        self.rendezvous = Rendezvous(worker, CONFIG)
        self.group: DistributedGroup | None = None
        self.error: Exception | None = None
        self.leave = threading.Event()

    def run(self) -> None:
        try:
            with self.rendezvous.gathered() as self.group:
                self.leave.wait(60)
        except (GroupLostError, UpdateStopped) as error:
            self.error = error


@contextlib.contextmanager
def gathering(worker: Worker) -> Iterator[First]:
    first = First(worker)
    first.start()
    yield first
    worker.stop.set()
    first.leave.set()
    first.join(30)
    assert not first.is_alive()


def test_an_update_begins_when_all_learners_are_there_and_its_sums_are_all_of_theirs(
    worker_of: Callable[[int], Worker], wait_for: WaitFor
) -> None:
    workers = [worker_of(rank) for rank in range(3)]
    sums: dict[int, float] = {}

    def take_part(rank: int) -> None:
        replies: list[RendezvousReply] = []
        wait_for(
            lambda: replies.append(ask(workers[rank])) or replies[-1].status == "meet",
            "the rendezvous",
        )
        assert replies[-1].host == "127.0.0.1"  # where the router is
        with contextlib.closing(join(workers[rank], replies[-1], CONFIG)) as group:
            values = torch.tensor([float(rank)])
            group.all_reduce_sum(values)
            sums[rank] = float(values)

    with gathering(workers[0]) as first:
        assert ask(workers[1]).status == "wait"
        wait_for(
            lambda: workers[0].waiting.snapshot()[0] == "learner 2 of 0..2", "rank 0 to say whom"
        )
        others = [threading.Thread(target=take_part, args=(rank,)) for rank in (1, 2)]
        for other in others:
            other.start()
        wait_for(lambda: first.group or first.error, "the group")
        assert first.error is None
        assert first.group is not None
        values = torch.tensor([10.0])
        first.group.all_reduce_sum(values)
        for other in others:
            other.join(30)
        assert sums == {1: 13.0, 2: 13.0}
        assert float(values) == 13.0
        assert ask(workers[1]).status == "wait"  # for the next one


def test_a_rank_is_one_workers_and_who_has_gone_leaves_it(
    worker_of: Callable[[int], Worker], monkeypatch: pytest.MonkeyPatch, wait_for: WaitFor
) -> None:
    monkeypatch.setattr(rendezvous, "PRESENT_S", 0.5)
    monkeypatch.setattr(rendezvous, "JOIN_TIMEOUT_S", 2.0)
    zero, one, two, spare = (worker_of(rank) for rank in range(4))
    with gathering(zero) as first:
        ask(one)
        assert ask(spare, rank=1).status == "wait"
        with pytest.raises(RefusedError, match=r"rank 3: this run has learners 0\.\.2"):
            ask(spare)
        wait_for(lambda: first.rendezvous._missing() == "learner 1, 2 of 0..2", "one to be gone")
        # The spare one now has the rank; that it does not come to the rendezvous loses the group.
        wait_for(
            lambda: ask(two) and ask(spare, rank=1).status == "meet", "the rendezvous", timeout_s=10
        )
        wait_for(lambda: first.error, "rank 0 to give the rendezvous up")
        assert isinstance(first.error, GroupLostError)
        assert "not all 3 learners came" in str(first.error)


def test_rank_0_can_be_stopped_while_it_waits(worker_of: Callable[[int], Worker]) -> None:
    with gathering(worker_of(0)) as first:
        pass
    assert isinstance(first.error, UpdateStopped)
