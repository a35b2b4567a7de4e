from dataclasses import dataclass
from uuid import UUID

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from bpn_dashboard.registry.leases import GRANT_S, IDLE_S, PATIENCE_S, Demand, LeaseBook, Place
from bpn_shared.messages.lease import Role

ROLES: tuple[Role, ...] = ("learner", "robot_sim", "edge")
A, B = UUID(int=1), UUID(int=2)


@dataclass
class Worker:
    role: Role
    label: str
    place: Place | None = None  # where it works or was told to
    token: bool = False  # the registry can see it there


def ask(book: LeaseBook, role: Role, worker: str, label: str, now_s: float) -> Place | None:
    """The first place that the worker could have is given to it."""
    for place in book.candidates(role, worker, label, now_s):
        assert book.grant(place, worker, now_s)
        return place
    return None


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


def filled(book: LeaseBook, role: Role, worker: str, label: str = "", now_s: float = 0.0) -> Place:
    place = ask(book, role, worker, label, now_s)
    assert place is not None
    book.appeared(place, worker, now_s)
    return place


def test_the_oldest_run_gets_the_first_learner_and_every_run_a_pair_before_a_second() -> None:
    book = LeaseBook()
    book.demand([Demand(A, 2), Demand(B, 2)])
    assert ask(book, "edge", "e0", "", 0.0) is None  # no run has a learner yet
    assert filled(book, "learner", "l0") == Place(A, "learner", 0)
    assert filled(book, "learner", "l1") == Place(B, "learner", 0)
    assert ask(book, "learner", "l2", "", 0.0) is None
    pairs = [filled(book, "robot_sim", f"r{i}", f"h/{i}") for i in range(4)]
    assert [(p.run, p.slot) for p in pairs] == [(A, 0), (B, 0), (A, 1), (B, 1)]
    for i in (3, 0, 2, 1):
        assert filled(book, "edge", f"e{i}", f"h/{i}") == pairs[i].partner


def test_an_edge_leaves_the_place_beside_a_robot_to_the_one_that_shares_its_core() -> None:
    book = LeaseBook()
    book.demand([Demand(A, 2)])
    filled(book, "learner", "l0")
    assert filled(book, "robot_sim", "r0", "h/0").slot == 0
    assert filled(book, "edge", "e1", "h/1").slot == 1
    assert filled(book, "edge", "e0", "h/0").slot == 0


def test_labels_that_are_equal_come_before_those_that_are_not_told() -> None:
    book = LeaseBook()
    book.demand([Demand(A, 2)])
    filled(book, "learner", "l0")
    assert filled(book, "robot_sim", "r0").slot == 0  # anywhere
    assert filled(book, "robot_sim", "r1", "h/1").slot == 1
    assert filled(book, "edge", "e1", "h/1").slot == 1
    assert filled(book, "edge", "e0", "h/0").slot == 0


def test_a_run_that_has_begun_gets_its_learners_before_an_older_one_begins() -> None:
    book = LeaseBook()
    book.demand([Demand(B, 1, 2)])
    book.appeared(Place(B, "learner", 0), "l0", 0.0)
    book.demand([Demand(A, 1, 2), Demand(B, 1, 2)])
    assert ask(book, "learner", "l1", "", 0.0) == Place(B, "learner", 1)


def test_a_lease_that_nobody_wants_is_ended_once() -> None:
    book = LeaseBook()
    book.demand([Demand(A, 1)])
    places = [filled(book, role, role) for role in ROLES]
    book.demand([])
    assert book.to_release(1000.0) == [(place, place.role) for place in places]


def test_nobody_is_moved_for_a_partner_that_is_only_being_restarted() -> None:
    book = LeaseBook()
    book.demand([Demand(A, 1), Demand(B, 1)])
    for run in "ab":
        filled(book, "learner", f"l{run}")
        filled(book, "robot_sim", f"r{run}")
        filled(book, "edge", f"e{run}")
    book.vanished(Place(A, "edge", 0), "ea", 1000.0)
    book.vanished(Place(B, "robot_sim", 0), "rb", 1000.0)
    assert book.to_release(1000.0 + PATIENCE_S - 1) == []
    assert book.to_release(1000.0 + PATIENCE_S + 1) == [(Place(B, "edge", 0), "eb")]


def test_a_pair_whose_learner_does_not_come_back_serves_a_run_that_has_one() -> None:
    book = LeaseBook()
    book.demand([Demand(A, 1), Demand(B, 1)])
    for worker in ("la", "lb"):
        filled(book, "learner", worker)
    pair = {(filled(book, "robot_sim", "r"), "r"), (filled(book, "edge", "e"), "e")}
    book.vanished(Place(A, "learner", 0), "la", 1000.0)
    assert book.to_release(1000.0 + PATIENCE_S - 1) == []
    assert set(book.to_release(1000.0 + PATIENCE_S + 1)) == pair
    for place, worker in pair:
        book.vanished(place, worker, 1012.0)
        assert filled(book, place.role, worker, now_s=1012.0) == Place(B, place.role, 0)


def test_a_grant_lasts_until_its_token_should_have_come_and_is_repeated() -> None:
    book = LeaseBook()
    book.demand([Demand(A, 1)])
    assert ask(book, "learner", "l0", "", 0.0) == Place(A, "learner", 0)
    assert ask(book, "learner", "l1", "", 1.0) is None
    assert ask(book, "learner", "l0", "", 2.0) == Place(A, "learner", 0)  # its answer was lost
    assert ask(book, "learner", "l1", "", 2.0 + GRANT_S + 0.1) == Place(A, "learner", 0)
    book.appeared(Place(A, "learner", 0), "l0", 8.0)  # late; whoever works has precedence
    book.appeared(Place(A, "learner", 0), "l1", 8.1)
    assert book.to_release(8.2) == [(Place(A, "learner", 0), "l1")]


def test_nothing_is_granted_while_tokens_are_still_being_told_nor_twice() -> None:
    book = LeaseBook()
    book.demand([Demand(A, 1), Demand(B, 1)])
    book.quiet(5.0)
    assert ask(book, "learner", "l0", "", 4.9) is None
    places = [Place(A, "learner", 0), Place(B, "learner", 0)]
    assert book.candidates("learner", "l0", "", 5.0) == places
    assert book.grant(places[1], "l0", 5.0)  # the first one was not admitted
    assert not book.grant(places[1], "l1", 5.0)
    assert book.holder(places[1]) == "l0"


def test_learners_complete_one_group_before_the_next_run_begins() -> None:
    book = LeaseBook()
    book.demand([Demand(A, 1, 2), Demand(B, 1, 2)])
    assert ask(book, "learner", "l0", "", 0.0) is None  # alone it is of no use
    places = [filled(book, "learner", f"l{i}") for i in (1, 2)]
    assert places == [Place(A, "learner", 0), Place(A, "learner", 1)]
    assert filled(book, "learner", "l0") == Place(B, "learner", 0)
    book.vanished(places[1], "l2", 1.0)
    assert filled(book, "learner", "l3") == places[1]  # the older run's lost one comes first
    assert filled(book, "learner", "l4") == Place(B, "learner", 1)


def test_learners_of_incomplete_groups_make_up_one_in_the_older_run() -> None:
    book = LeaseBook()
    book.demand([Demand(A, 1, 2), Demand(B, 1, 2)])
    for i, run in enumerate((A, A, B, B)):
        book.appeared(Place(run, "learner", i % 2), f"l{i}", 0.0)
    for run, worker in ((A, "l1"), (B, "l3")):
        book.vanished(Place(run, "learner", 1), worker, 1000.0)
        book.gone(worker)
    assert book.to_release(1000.0 + PATIENCE_S - 1) == []
    assert book.to_release(1000.0 + PATIENCE_S + 1) == [(Place(B, "learner", 0), "l2")]
    book.vanished(Place(B, "learner", 0), "l2", 1012.0)
    assert filled(book, "learner", "l2", now_s=1012.0) == Place(A, "learner", 1)
    assert book.to_release(1100.0) == []


def test_robots_serve_the_run_whose_learners_are_complete_not_the_older_one_that_waits() -> None:
    book = LeaseBook()
    book.demand([Demand(A, 1, 2), Demand(B, 1)])
    assert filled(book, "learner", "l0") == Place(B, "learner", 0)  # too few for the older run
    assert filled(book, "learner", "l1") == Place(A, "learner", 0)
    assert filled(book, "edge", "e") == Place(B, "edge", 0)
    assert filled(book, "robot_sim", "r") == Place(B, "robot_sim", 0)
    book.demand([Demand(A, 1, 2)])
    for place, worker in book.to_release(0.0):
        book.vanished(place, worker, 0.0)
    assert filled(book, "learner", "l0") == Place(A, "learner", 1)
    assert filled(book, "robot_sim", "r") == Place(A, "robot_sim", 0)


def test_a_run_that_wants_more_learners_than_there_are_keeps_nobody_waiting() -> None:
    book = LeaseBook()
    book.demand([Demand(A, 1, 3), Demand(B, 1)])
    assert filled(book, "learner", "l0") == Place(B, "learner", 0)
    assert ask(book, "learner", "l1", "", 0.0) is None
    assert filled(book, "learner", "l2") == Place(A, "learner", 0)  # now there are three
    assert filled(book, "learner", "l1") == Place(A, "learner", 1)
    book.demand([Demand(A, 1, 3), Demand(B, 1), Demand(UUID(int=3), 1)])
    book.vanished(Place(A, "learner", 1), "l1", 1000.0)
    book.gone("l1")
    assert book.to_release(1011.0) == [(Place(A, "learner", 0), "l2")]


def test_of_a_worker_that_has_gone_nothing_is_kept() -> None:
    book = LeaseBook()
    book.demand([Demand(A, 1)])
    place = filled(book, "learner", "l0", "h/0")
    assert (book.learners(), book.idle("learner", 0.0)) == (1, set())
    book.vanished(place, "l0", 1.0)
    assert book.idle("learner", 1.0) == {"l0"}  # it asked a moment ago
    book.gone("l0")
    assert (book.learners(), book.idle("learner", 1.0)) == (0, set())
    empty = LeaseBook()
    empty.demand([Demand(A, 1)])
    kept = vars(book) | {"_left_s": {}}  # of the place, not of the worker
    assert kept == vars(empty)


def test_second_holders_follow_in_the_order_in_which_they_came() -> None:
    book, place = LeaseBook(), Place(A, "edge", 0)
    book.demand([Demand(A, 1)])
    for worker in ("e0", "e1", "e2", "e1"):
        book.appeared(place, worker, 0.0)
    assert book.to_release(0.0) == [(place, "e1"), (place, "e2")]
    for now_s, holder in ((1.0, "e1"), (2.0, "e2")):
        book.vanished(place, str(book.holder(place)), now_s)
        assert book.holder(place) == holder
        assert book.is_confirmed(place)
        assert book.held_s(place, now_s + 5.0) == 5.0
    book.vanished(place, "e2", 3.0)
    assert book.holder(place) is None
    assert book.to_release(3.0) == []


def test_a_deposed_holder_leaves_its_place_to_another_and_is_told_to_let_go() -> None:
    book, place = LeaseBook(), Place(A, "learner", 0)
    book.demand([Demand(A, 1)])
    filled(book, "learner", "l0")
    assert ask(book, "learner", "l1", "", 1.0) is None
    book.depose(place, 1.0)
    assert book.to_release(1.0) == [(place, "l0")]
    assert filled(book, "learner", "l1", now_s=2.0) == place
    assert book.to_release(2.0) == [(place, "l0")]
    book.vanished(place, "l0", 3.0)
    assert book.holder(place) == "l1"
    assert book.to_release(3.0) == []


def test_idle_is_who_asked_lately_and_has_nothing() -> None:
    book = LeaseBook()
    book.demand([Demand(A, 1)])
    filled(book, "learner", "l0")
    filled(book, "edge", "e0")
    assert ask(book, "edge", "e1", "", 10.0) is None
    assert book.idle("edge", 10.0 + IDLE_S) == {"e1"}
    assert book.idle("edge", 10.1 + IDLE_S) == set()
    assert book.idle("robot_sim", 10.0) == set()


def test_what_a_run_lacks_and_which_runs_are_before_it() -> None:
    book = LeaseBook()
    c = UUID(int=3)
    book.demand([Demand(A, 1), Demand(B, 2, 2), Demand(c, 1)])
    assert book.positions() == {A: 0, B: 1, c: 2}
    assert [book.wanted(run) for run in (A, B, c, UUID(int=9))] == [1, 2, 1, 0]
    assert book.missing(B) == [
        Place(B, "learner", 0), Place(B, "learner", 1), Place(B, "robot_sim", 0),
        Place(B, "robot_sim", 1), Place(B, "edge", 0), Place(B, "edge", 1),
    ]  # fmt: skip
    filled(book, "learner", "l0")
    assert book.positions() == {A: 0, B: 0, c: 1}  # one that has its learner keeps nobody waiting
    filled(book, "edge", "e0")
    assert book.missing(A) == [Place(A, "robot_sim", 0)]
    assert book.missing(UUID(int=9)) == []
