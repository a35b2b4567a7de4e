"""Who gets which place, by examples."""

from uuid import UUID

from lease_books import ROLES, A, B, ask, filled

from bpn_dashboard.registry.leases import GRANT_S, IDLE_S, PATIENCE_S, Demand, LeaseBook, Place


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
