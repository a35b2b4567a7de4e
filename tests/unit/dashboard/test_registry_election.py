from dataclasses import dataclass, field

from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from bpn_dashboard.registry.election import MISSED_S, SETTLE_S, Election


def key(name: str) -> str:
    return f"bpn/registry/serving/host/12/dashboard-{name}"


@dataclass
class Candidate:
    election: Election
    seen: set[str] = field(default_factory=set)


class Candidates(RuleBasedStateMachine):
    """Dashboards on one router; what one does the others see a little later."""

    def __init__(self) -> None:
        super().__init__()
        self.now_s = 0.0
        self.made = 0
        self.there: dict[str, Candidate] = {}

    def serving(self) -> set[str]:
        return {name for name, candidate in self.there.items() if candidate.election.serves}

    @rule()
    def one_begins(self) -> None:
        self.made += 1
        name = key(str(self.made))
        self.there[name] = Candidate(Election(name, self.now_s))

    @rule(data=st.data())
    def one_ends(self, data: st.DataObject) -> None:
        if self.there:
            del self.there[data.draw(st.sampled_from(sorted(self.there)))]

    @rule(data=st.data())
    def one_sees_the_tokens(self, data: st.DataObject) -> None:
        if self.there:
            self.see(data.draw(st.sampled_from(sorted(self.there))))

    @rule(data=st.data())
    def one_decides(self, data: st.DataObject) -> None:
        if self.there:
            self.there[data.draw(st.sampled_from(sorted(self.there)))].election.decide(self.now_s)

    @rule(seconds=st.sampled_from([0.3, SETTLE_S + 0.1, MISSED_S + 0.1]))
    def time_passes(self, seconds: float) -> None:
        self.now_s += seconds

    def see(self, name: str) -> None:
        candidate, now = self.there[name], self.serving()
        for other in now - candidate.seen:
            candidate.election.token(other, True, self.now_s)
        for other in candidate.seen - now:
            candidate.election.token(other, False, self.now_s)
        candidate.seen = now

    def settle(self) -> None:
        """Everybody sees everything soon after it happens."""
        for _ in range(30):
            for name in self.there:
                self.see(name)
            for candidate in self.there.values():
                candidate.election.decide(self.now_s)
            self.now_s += 0.5

    @invariant()
    def once_settled_it_serves_or_says_who_does(self) -> None:
        for candidate in self.there.values():
            election = candidate.election
            assert election.settled == (election.serves or election.rival is not None)

    @invariant()
    def who_does_not_serve_says_who_does(self) -> None:
        for candidate in self.there.values():
            assert not (candidate.election.serves and candidate.election.rival)

    def teardown(self) -> None:
        self.settle()
        assert len(self.serving()) == min(1, len(self.there))
        (server,) = self.serving() or {None}
        for name, candidate in self.there.items():
            if name != server:
                assert str(candidate.election.rival) == (
                    "another dashboard (host, pid 12) serves this router: read-only"
                )


TestCandidates = Candidates.TestCase
TestCandidates.settings = settings(max_examples=60, stateful_step_count=30, deadline=None)


@given(st.sampled_from(["1", "9"]))
def test_who_comes_later_does_not_take_over_however_it_is_called(name: str) -> None:
    late = Election(key(name), 0.0)
    late.token(key("5"), True, 0.1)
    assert not late.decide(100.0)
    late.token(key("5"), False, 100.0)
    assert not late.decide(100.0 + MISSED_S - 0.1)  # it may only have lost the router for a moment
    assert late.decide(100.0 + MISSED_S)


def test_nobody_begins_to_serve_a_router_that_is_not_reached() -> None:
    second = Election(key("1"), 0.0)
    second.token(key("5"), True, 0.1)
    second.token(key("5"), False, 50.0)  # as all are, without the router
    assert not second.decide(100.0, connected=False)
    assert not second.settled
    second.reconnected(100.0)
    second.token(key("5"), True, 101.0)
    assert not second.decide(200.0)
    alone = Election(key("1"), 0.0)
    assert alone.decide(SETTLE_S)
    assert alone.decide(100.0, connected=False)  # who serves goes on


def test_who_lost_the_router_for_a_moment_waits_for_others_tokens() -> None:
    waiting = Election(key("1"), 0.0)
    waiting.token(key("5"), True, 0.1)
    waiting.token(key("5"), False, 50.0)
    waiting.reconnected(54.0)
    assert not waiting.decide(55.5)
    waiting.token(key("5"), True, 56.0)
    assert not waiting.decide(100.0)
