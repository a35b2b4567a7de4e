"""What each role may do at each key, and that everything else is refused: real sessions, mutual TLS.

The keys are those of the key table, and every role tries every operation at every one of them. What must get
through is taken from the grants; what must not is all the rest. A few cases written by hand keep the table
itself honest.
"""

import threading
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest
import zenoh

from bpn_shared.bus import keys
from bpn_shared.bus.access import CHANNELS, ENVELOPE_BYTES, ROLES, Channel, Role, grants
from bpn_shared.bus.requests import Responder
from bpn_shared.bus.router_config import render, secure
from bpn_shared.bus.session import Bus
from bpn_shared.counters import Counters

OpenAs = Callable[[str], Bus]
WaitFor = Callable[..., None]

OBSERVER = "observer"
ROUTER_FILE = Path(__file__).parents[2] / "deploy" / "router" / "router.json5"
MEMBER = "m1"
"""What stands for the wildcards of patterns."""


def key_of(channel: Channel) -> str:
    return channel.key.replace("$*", "0").replace("*", MEMBER)


KEYS = sorted({key_of(c) for c in CHANNELS if c.givers and not c.key.startswith("@")})
each_role = pytest.mark.parametrize("role", ROLES)


def permitted(role: str, *operations: tuple[str, str]) -> set[str]:
    """The keys at which a role may do all of these (flow, message)."""
    granted = grants()

    def may(flow: str, message: str, key: str) -> bool:
        return any(
            grant[:3] == (role, flow, message) and zenoh.KeyExpr(grant.key).includes(key)
            for grant in granted
        )

    return {key for key in KEYS if all(may(flow, message, key) for flow, message in operations)}


class Seen:
    """Keys of what came, from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._keys: set[str] = set()

    def note(self, message: zenoh.Sample | zenoh.Query) -> None:
        with self._lock:
            self._keys.add(str(message.key_expr))

    def at(self) -> set[str]:
        with self._lock:
            return set(self._keys)


class Fence:
    """When `pass_through` returns, the router has handled what this session declared before, and the session
    has got what was sent to it before: messages of one link keep their order."""

    def __init__(self, role: str, bus: Bus) -> None:
        self._key = keys.health(role, "fence")
        self._responder = Responder(bus, self._key, lambda body: body, Counters())

    def pass_through(self, observer: Bus, wait_for: WaitFor) -> None:
        def answered() -> bool:
            replies = observer.zenoh.get(self._key, timeout=2.0)
            return any(reply.ok is not None for reply in replies)

        wait_for(answered, f"an answer at {self._key}")


def direct(handler: Callable[[zenoh.Sample], None]) -> "zenoh.handlers.Callback[zenoh.Sample]":
    return zenoh.handlers.Callback(handler, indirect=False)


@each_role
def test_publishes_what_it_may_and_nothing_else(
    open_as: OpenAs, wait_for: WaitFor, role: Role
) -> None:
    observer, bus, seen = open_as(OBSERVER), open_as(role), Seen()
    subscriber = observer.zenoh.declare_subscriber("bpn/**", direct(seen.note))
    allowed = permitted(role, ("ingress", "put"))
    last = keys.telemetry(role, "fence")
    wait_for(lambda: bus.zenoh.put(last, b"") or last in seen.at(), "the first message")
    for key in KEYS:
        bus.zenoh.put(key, b"1")
        bus.zenoh.delete(key)
    end = keys.telemetry(role, "end")
    bus.zenoh.put(end, b"", congestion_control=zenoh.CongestionControl.BLOCK)
    wait_for(lambda: end in seen.at(), "the last message")
    assert seen.at() - {last, end} == allowed
    del subscriber


@each_role
def test_subscribes_to_what_it_may_and_nothing_else(
    open_as: OpenAs, wait_for: WaitFor, role: Role
) -> None:
    observer, bus, seen = open_as(OBSERVER), open_as(role), Seen()
    subscribers = [
        bus.zenoh.declare_subscriber(key, direct(seen.note)) for key in [*KEYS, "bpn/**", "**"]
    ]
    fence = Fence(role, bus)
    fence.pass_through(observer, wait_for)
    for key in KEYS:
        observer.zenoh.put(key, b"1", congestion_control=zenoh.CongestionControl.BLOCK)
    fence.pass_through(observer, wait_for)
    assert seen.at() == permitted(role, ("ingress", "declare_subscriber"), ("egress", "put"))
    del subscribers


def ask_all(bus: Bus, asked: Iterable[str], timeout_s: float) -> set[str]:
    """The keys at which somebody answered."""
    replies = {key: bus.zenoh.get(key, payload=b"1", timeout=timeout_s) for key in asked}
    return {key for key, of_key in replies.items() if any(reply.ok is not None for reply in of_key)}


@each_role
def test_asks_whom_it_may_and_nobody_else(open_as: OpenAs, wait_for: WaitFor, role: Role) -> None:
    observer, bus, seen = open_as(OBSERVER), open_as(role), Seen()

    def answer(query: zenoh.Query) -> None:
        with query:
            seen.note(query)
            query.reply(query.key_expr, b"1")

    queryable = observer.zenoh.declare_queryable("bpn/**", answer, complete=True)
    allowed = permitted(role, ("ingress", "query"), ("egress", "reply"))
    wait_for(lambda: ask_all(bus, allowed, 2.0) == allowed, f"answers at {allowed}")
    assert ask_all(bus, KEYS, 2.0) == allowed
    assert seen.at() == allowed
    del queryable


@each_role
def test_answers_where_it_may_and_nowhere_else(
    open_as: OpenAs, wait_for: WaitFor, role: Role
) -> None:
    observer, bus = open_as(OBSERVER), open_as(role)

    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, b"1")

    queryables = [bus.zenoh.declare_queryable(key, answer, complete=True) for key in KEYS]
    Fence(role, bus).pass_through(observer, wait_for)
    assert ask_all(observer, KEYS, 2.0) == permitted(
        role, ("ingress", "declare_queryable"), ("egress", "query"), ("ingress", "reply")
    )
    del queryables


@each_role
def test_holds_the_tokens_that_it_may_and_no_others(
    open_as: OpenAs, wait_for: WaitFor, role: Role
) -> None:
    observer, bus, seen = open_as(OBSERVER), open_as(role), Seen()
    watch = observer.zenoh.liveliness().declare_subscriber("bpn/**", direct(seen.note))
    list(observer.zenoh.liveliness().get("bpn/**", timeout=2.0))  # the router knows the watch
    tokens = [bus.zenoh.liveliness().declare_token(key) for key in KEYS]
    end = keys.live(role, "end")
    tokens.append(bus.zenoh.liveliness().declare_token(end))
    allowed = permitted(role, ("ingress", "liveliness_token")) | {end}
    wait_for(lambda: seen.at() >= allowed, "its tokens, the last one among them")
    assert seen.at() == allowed
    del watch, tokens


@each_role
def test_watches_the_tokens_that_it_may_and_no_others(
    open_as: OpenAs, wait_for: WaitFor, role: Role
) -> None:
    observer, bus, seen = open_as(OBSERVER), open_as(role), Seen()
    before, after = KEYS[::2], KEYS[1::2]
    tokens = [observer.zenoh.liveliness().declare_token(key) for key in before]
    watches = [
        bus.zenoh.liveliness().declare_subscriber(key, direct(seen.note), history=True)
        for key in [*KEYS, "bpn/**", "**"]
    ]
    fence = Fence(role, bus)
    fence.pass_through(observer, wait_for)
    tokens += [observer.zenoh.liveliness().declare_token(key) for key in after]
    fence.pass_through(observer, wait_for)
    allowed = permitted(
        role, ("ingress", "declare_liveliness_subscriber"), ("egress", "liveliness_token")
    )
    wait_for(lambda: allowed <= seen.at(), f"tokens at {allowed}")
    assert seen.at() == allowed
    asked = {
        str(reply.ok.key_expr)
        for reply in bus.zenoh.liveliness().get("bpn/**", timeout=1.0)
        if reply.ok is not None
    }
    assert asked <= allowed
    del watches, tokens


@each_role
def test_the_routers_state_is_read_by_the_dashboard_alone(open_as: OpenAs, role: Role) -> None:
    replies = open_as(role).zenoh.get("@/*/router", timeout=2.0)
    assert any(reply.ok is not None for reply in replies) == (role == "dashboard")


def test_the_routers_configuration_is_written_by_nobody(open_as: OpenAs, wait_for: WaitFor) -> None:
    observer, robot, seen = open_as(OBSERVER), open_as("robot_sim"), Seen()
    (router_id,) = observer.zenoh.info.routers_zid()
    observer.zenoh.put(f"@/{router_id}/router/config/access_control/enabled", b"false")
    weights = keys.weights("*").replace("*", MEMBER)
    subscriber = observer.zenoh.declare_subscriber(weights, direct(seen.note))
    robot.zenoh.put(weights, b"1")
    Fence("robot_sim", robot).pass_through(observer, wait_for)
    assert not seen.at()
    del subscriber


@pytest.mark.parametrize(
    ("role", "message", "key"),
    [
        ("robot_sim", "put", "bpn/r/robot/s/0/action"),
        ("robot_sim", "put", "bpn/r/weights"),
        ("robot_sim", "put", "bpn/r/metrics/learner/x"),
        ("robot_sim", "query", "bpn/r/learner/episode"),
        ("robot_sim", "query", "bpn/r/learner/next"),
        ("robot_sim", "query", "bpn/control/learner/x"),
        ("robot_sim", "declare_subscriber", "bpn/r/weights"),
        ("robot_sim", "declare_subscriber", "bpn/r/robot/s/0/frame"),
        ("robot_sim", "liveliness_token", "bpn/live/learner/x"),
        ("edge", "put", "bpn/r/weights"),
        ("edge", "put", "bpn/r/robot/s/0/frame"),
        ("edge", "query", "bpn/control/robot_sim/x"),
        ("edge", "declare_queryable", "bpn/r/learner/next"),
        ("edge", "liveliness_token", "bpn/lease/r/learner/0/x"),
        ("edge", "query", "bpn/r/learner/rendezvous"),
        ("edge", "declare_queryable", "bpn/r/learner/rendezvous"),
        ("learner", "put", "bpn/r/robot/s/0/action"),
        ("learner", "query", "bpn/control/edge/x"),
        ("learner", "declare_queryable", "bpn/registry/lease/s"),
        ("dashboard", "put", "bpn/r/weights"),
        ("dashboard", "put", "bpn/r/robot/s/0/action"),
        ("dashboard", "query", "bpn/r/learner/episode"),
    ],
)
def test_the_table_grants_no_role_another_ones_part(role: str, message: str, key: str) -> None:
    assert not [
        grant
        for grant in grants()
        if (grant.role, grant.flow, grant.message) == (role, "ingress", message)
        and zenoh.KeyExpr(grant.key).intersects(key)
    ]


def test_every_key_of_the_system_is_in_the_table() -> None:
    for name, function in vars(keys).items():
        of_keys = getattr(function, "__module__", "") == keys.__name__
        if of_keys and function.__annotations__["return"] is str:  # what makes a key
            parameters = function.__annotations__.keys() - {"return"}
            key = zenoh.KeyExpr(function(**dict.fromkeys(parameters, keys.ANY)))
            assert any(key.includes(c.key) for c in CHANNELS if c.givers), name


@pytest.mark.parametrize(
    ("role", "key"),
    [
        ("robot_sim", keys.frame("*", "*", "*")),
        ("edge", keys.action("*", "*", "*")),
        ("learner", keys.weights("*")),
        ("edge", keys.metrics("*", "edge", "*")),
    ],
)
def test_what_is_larger_than_its_channel_allows_does_not_get_through(
    open_as: OpenAs, wait_for: WaitFor, role: Role, key: str
) -> None:
    (limit,) = {c.max_bytes + ENVELOPE_BYTES for c in CHANNELS if c.key == key}
    observer, bus = open_as(OBSERVER), open_as(role)
    sizes: list[int] = []
    concrete = key.replace("*", MEMBER)
    subscriber = observer.zenoh.declare_subscriber(
        concrete, direct(lambda sample: sizes.append(len(sample.payload)))
    )

    def put(size: int) -> None:
        blocking = zenoh.CongestionControl.BLOCK
        bus.zenoh.put(concrete, bytes(size), congestion_control=blocking)

    wait_for(lambda: put(1) or sizes, "the first message")
    put(limit + 1)
    put(limit)
    put(2)
    wait_for(lambda: 2 in sizes, "the last message")
    assert limit in sizes
    assert limit + 1 not in sizes
    del subscriber


def test_a_request_that_is_too_large_is_not_heard(open_as: OpenAs, wait_for: WaitFor) -> None:
    learner, edge = open_as("learner"), open_as("edge")
    key = keys.next_episode("*").replace("*", MEMBER)
    sizes: list[int] = []
    responder = Responder(learner, key, lambda body: sizes.append(len(body)) or b"", Counters())
    wait_for(lambda: ask_all(edge, [key], 2.0), "an answer")
    for reply in edge.zenoh.get(key, payload=bytes(128 * 1024), timeout=1.0):
        assert reply.ok is None
    assert max(sizes) == 1
    del responder


def test_the_routers_file_is_what_the_table_says() -> None:
    assert ROUTER_FILE.read_text() == render(secure()), (
        "make it anew: python -m bpn_shared.bus.router_config > deploy/router/router.json5"
    )
