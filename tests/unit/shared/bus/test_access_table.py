"""The access table, right by right. Whether a router keeps to it is in tests/security/test_access.py."""

from uuid import UUID

import pytest
import zenoh

from bpn_shared.bus import keys
from bpn_shared.bus.access import CHANNELS, MAX_PIXEL_BYTES, MAX_WEIGHTS_BYTES, ROLES, Grant, grants
from bpn_shared.messages.base import MAX_CONTROL_BYTES
from bpn_shared.messages.episode import MAX_BYTES as MAX_EPISODE_BYTES

RUN = UUID(int=7)
RIGHTS = {
    "publish": [("ingress", "put")],
    "get": [("ingress", "declare_subscriber"), ("egress", "put")],
    "ask": [("ingress", "query"), ("egress", "reply")],
    "answer": [("ingress", "declare_queryable"), ("egress", "query"), ("ingress", "reply")],
    "hold": [("ingress", "liveliness_token")],
    "watch": [
        ("ingress", "liveliness_query"),
        ("ingress", "declare_liveliness_subscriber"),
        ("egress", "liveliness_token"),
    ],
}
ALL, WORKERS = set(ROLES), {"learner", "edge", "robot_sim"}

# Who may do what, of a key that is really used. What is not said here nobody may.
WHO: dict[str, dict[str, set[str]]] = {
    keys.frame(RUN, 0): {"publish": {"robot_sim"}, "get": {"edge"}},
    keys.action(RUN, 0): {"publish": {"edge"}, "get": {"robot_sim"}},
    keys.reset(RUN, 0): {"ask": {"edge"}, "answer": {"robot_sim"}},
    keys.local_link(RUN, 0, "main", "x"): {"hold": {"robot_sim"}, "watch": {"edge"}},
    keys.preview(RUN, 0): {"publish": {"robot_sim"}, "get": {"dashboard"}},
    keys.decision(RUN, 0): {"publish": {"edge"}, "get": {"dashboard"}},
    keys.config(RUN): {"ask": WORKERS, "answer": {"learner"}},
    keys.rendezvous(RUN): {"ask": {"learner"}, "answer": {"learner"}},
    keys.next_episode(RUN): {"ask": {"edge"}, "answer": {"learner"}},
    keys.episode(RUN): {"ask": {"edge"}, "answer": {"learner"}},
    keys.fault(RUN): {"ask": {"edge", "robot_sim"}, "answer": {"learner"}},
    keys.weights(RUN): {
        "publish": {"learner"},
        "get": {"edge"},
        "ask": {"edge"},
        "answer": {"learner"},
    },
    keys.log(RUN, "learner"): {"publish": {"learner"}, "get": {"learner"}},
    keys.log(RUN, "learner-1"): {"publish": {"learner"}, "get": {"learner"}},
    keys.log(RUN, "edge-0"): {"publish": {"edge"}, "get": {"learner"}},
    keys.log(RUN, "robot_sim-0"): {"publish": {"robot_sim"}, "get": {"learner"}},
    keys.metrics(RUN, "learner", "x"): {"publish": {"learner"}, "get": {"dashboard"}},
    keys.metrics(RUN, "edge", "x"): {"publish": {"edge"}, "get": {"dashboard"}},
    keys.live("learner", "x"): {"hold": {"learner"}, "watch": {"edge", "dashboard"}},
    keys.live("edge", "x"): {"hold": {"edge"}, "watch": {"learner", "dashboard"}},
    keys.live("robot_sim", "x"): {"hold": {"robot_sim"}, "watch": {"dashboard"}},
    keys.live("dashboard", "x"): {"hold": {"dashboard"}, "watch": {"dashboard"}},
    keys.lease_request(): {"ask": WORKERS, "answer": {"dashboard"}},
    keys.LEASE_REQUEST_OF_EARLIER: {"ask": WORKERS, "answer": {"dashboard"}},
    keys.serving("h", "1", "x"): {"hold": {"dashboard"}, "watch": {"dashboard"}},
    keys.probe(): {"ask": {"dashboard"}, "answer": {"robot_sim"}},
    "@/1/router": {"ask": {"dashboard"}},
    **{keys.telemetry(role, "x"): {"publish": {role}, "get": {"dashboard"}} for role in ROLES},
    **{keys.health(role, "x"): {"ask": {"dashboard"}, "answer": {role}} for role in ROLES},
    **{
        keys.control(role, "x"): {"ask": {"dashboard"}, "answer": {role}}
        for role in sorted(WORKERS)
    },
    **{
        keys.lease(RUN, role, 0, "x"): {"hold": {role}, "watch": {"dashboard"}}
        for role in sorted(WORKERS)
    },
}
LARGE = {
    keys.frame(RUN, 0): MAX_PIXEL_BYTES,
    keys.preview(RUN, 0): MAX_PIXEL_BYTES,
    keys.weights(RUN): MAX_WEIGHTS_BYTES,
    keys.episode(RUN): MAX_EPISODE_BYTES,
}


def is_at(pattern: str, key: str) -> bool:
    return zenoh.KeyExpr(pattern).includes(zenoh.KeyExpr(key))


@pytest.mark.parametrize("key", WHO)
def test_a_key_is_for_those_who_need_it_and_nobody_else(key: str) -> None:
    expected = {
        (role, flow, message)
        for right, roles in WHO[key].items()
        for role in roles
        for flow, message in RIGHTS[right]
    }
    told = {
        (role, "egress", m) for role in ALL for m in ("declare_subscriber", "declare_queryable")
    }
    if key.startswith("bpn/"):  # whoever sends is told that somebody listens
        expected |= told
    assert {grant[:3] for grant in grants() if is_at(grant.key, key)} == expected


def test_every_channel_is_of_such_a_key() -> None:
    assert [c.key for c in CHANNELS if not any(is_at(c.key, key) for key in WHO)] == []
    assert {c.way for c in CHANNELS} == {"stream", "request", "token"}


@pytest.mark.parametrize("key", WHO)
def test_a_payload_is_as_large_as_its_kind_may_be(key: str) -> None:
    sizes = {channel.max_bytes for channel in CHANNELS if is_at(channel.key, key)}
    assert sizes == {LARGE.get(key, MAX_CONTROL_BYTES)}


def test_the_largest_payloads_are_half_a_mebibyte_and_eight() -> None:
    assert MAX_PIXEL_BYTES == 2**19
    assert MAX_WEIGHTS_BYTES == 2**24


def test_a_grant_is_of_one_of_the_roles() -> None:
    assert {grant.role for grant in grants()} == ALL
    assert Grant("edge", "ingress", "put", keys.action("*", "*", "*")) in grants()
