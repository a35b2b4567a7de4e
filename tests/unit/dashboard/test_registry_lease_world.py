"""Who gets which place, whatever workers, runs and registries do."""

from dataclasses import dataclass
from uuid import UUID

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule
from lease_books import ROLES, ask

from bpn_dashboard.registry.leases import GRANT_S, PATIENCE_S, Demand, LeaseBook, Place
from bpn_shared.messages.lease import Role


@dataclass
class Worker:
    role: Role
    label: str
    place: Place | None = None  # where it works or was told to
    token: bool = False  # the registry can see it there


class World(RuleBasedStateMachine):
    """Workers that come, go, are cut off and return; runs that come and go; registries that restart."""

    def __init__(self) -> None:
        super().__init__()
        self.now_s = 0.0
        self.book = LeaseBook()
        self.demands: list[Demand] = []
        self.runs = self.made = 0
        self.workers: dict[str, Worker] = {}

    def some(self, data: st.DataObject, **states: object) -> str | None:
        names = [
            name
            for name, worker in self.workers.items()
            if all(getattr(worker, key) == value for key, value in states.items())
        ]
        return data.draw(st.sampled_from(names)) if names else None

    @rule(role=st.sampled_from(ROLES), label=st.sampled_from(["", "h/0", "h/1"]))
    def a_worker_starts(self, role: Role, label: str) -> None:
        self.made += 1
        self.workers[f"{role}-{self.made}"] = Worker(role, label)

    @rule(slots=st.integers(1, 3), learners=st.integers(1, 3))
    def a_run_is_made(self, slots: int, learners: int) -> None:
        self.runs += 1
        self.demands.append(Demand(UUID(int=self.runs), slots, learners))
        self.book.demand(self.demands)

    @precondition(lambda self: self.demands)
    @rule(data=st.data())
    def a_run_ends(self, data: st.DataObject) -> None:
        self.demands.remove(data.draw(st.sampled_from(self.demands)))
        self.book.demand(self.demands)

    def has(self, places: list[Place]) -> bool:
        return all(self.book.holder(place) is not None for place in places)

    def ask(self, name: str) -> None:
        worker = self.workers[name]
        worker.place = ask(self.book, worker.role, name, worker.label, self.now_s)
        if worker.place is None:
            return
        place = worker.place
        assert place.role == worker.role
        demands = {demand.run: demand for demand in self.demands}
        assert place in demands[place.run].places(place.role)
        assert not [w for w in self.workers.values() if w.token and w.place == place]
        assert place.role == "learner" or self.has(demands[place.run].places("learner"))

    @rule(data=st.data())
    def an_idle_worker_asks(self, data: st.DataObject) -> None:
        if (name := self.some(data, place=None)) is not None:
            self.ask(name)

    @rule(data=st.data())
    def a_worker_asks_again_because_no_answer_came(self, data: st.DataObject) -> None:
        if (name := self.some(data, token=False)) is not None:
            self.ask(name)

    def arrive(self, name: str) -> None:
        worker = self.workers[name]
        if worker.place is not None and not worker.token:
            worker.token = True
            self.book.appeared(worker.place, name, self.now_s)

    @rule(data=st.data())
    def a_token_appears(self, data: st.DataObject) -> None:
        """Of a worker that was granted a place, or that was cut off for a while."""
        if (name := self.some(data, token=False)) is not None:
            self.arrive(name)

    @rule(data=st.data())
    def a_worker_is_cut_off(self, data: st.DataObject) -> None:
        if (name := self.some(data, token=True)) is not None:
            self.workers[name].token = False
            place = self.workers[name].place
            assert place is not None
            self.book.vanished(place, name, self.now_s)

    @rule(data=st.data())
    def a_worker_dies(self, data: st.DataObject) -> None:
        if (name := self.some(data)) is not None:
            worker = self.workers.pop(name)
            if worker.token and worker.place is not None:
                self.book.vanished(worker.place, name, self.now_s)
            self.book.gone(name)

    def drop(self, name: str) -> None:
        worker = self.workers[name]
        if worker.token and worker.place is not None:
            self.book.vanished(worker.place, name, self.now_s)
        worker.place, worker.token = None, False

    @rule()
    def releases_are_obeyed(self) -> None:
        for place, name in self.book.to_release(self.now_s):
            assert self.workers[name].place == place
            self.drop(name)

    @rule(seconds=st.sampled_from([0.5, GRANT_S + 0.1, PATIENCE_S + 0.1]))
    def time_passes(self, seconds: float) -> None:
        self.now_s += seconds

    @rule(data=st.data())
    def the_registry_restarts(self, data: st.DataObject) -> None:
        self.book = LeaseBook()
        self.book.demand(self.demands)
        tokens = [(w.place, name) for name, w in self.workers.items() if w.token and w.place]
        for place, name in data.draw(st.permutations(tokens)):
            self.book.appeared(place, name, self.now_s)

    @invariant()
    def nobody_works_beside_another_without_being_released(self) -> None:
        released = set(self.book.to_release(self.now_s))
        wanted = {demand.run for demand in self.demands}
        staying: dict[Place, str] = {}
        for name, worker in self.workers.items():
            if worker.token and worker.place and (worker.place, name) not in released:
                assert worker.place not in staying, (name, staying[worker.place])
                assert worker.place.run in wanted
                assert self.book.holder(worker.place) == name
                staying[worker.place] = name

    def teardown(self) -> None:
        """Left alone, everything finds its place and stays there."""
        for _ in range(60):
            self.releases_are_obeyed()
            for name in [n for n, worker in self.workers.items() if worker.place is None]:
                self.ask(name)
            for name in list(self.workers):
                self.arrive(name)
            self.now_s += 1.0
        self.nobody_works_beside_another_without_being_released()
        assert self.book.to_release(self.now_s) == []
        idle = [worker for worker in self.workers.values() if worker.place is None]
        learners = sum(worker.role == "learner" for worker in self.workers.values())
        for demand in self.demands:
            has_learners = self.has(demand.places("learner"))
            if demand.learners <= learners and not has_learners:
                assert not [worker for worker in idle if worker.role == "learner"]
            for role in ("robot_sim", "edge"):
                if has_learners and not self.has(demand.places(role)):
                    assert not [worker for worker in idle if worker.role == role]
        if self.demands and {worker.role for worker in self.workers.values()} == set(ROLES):
            possible = [demand for demand in self.demands if demand.learners <= learners]
            assert not possible or any(
                self.has([robot, robot.partner, *demand.places("learner")])
                for demand in possible
                for robot in demand.places("robot_sim")
            ), "some run could go on, and none does"


TestWorld = World.TestCase
TestWorld.settings = settings(max_examples=150, stateful_step_count=40, deadline=None)
