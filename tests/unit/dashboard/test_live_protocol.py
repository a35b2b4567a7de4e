import json
import math
from uuid import UUID

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bpn_dashboard.hub import protocol
from bpn_dashboard.hub.protocol import (
    Ack,
    ClientMessage,
    Hello,
    LiveFrame,
    Ping,
    ProtocolError,
    Subscribe,
    Unsubscribe,
)
from bpn_dashboard.hub.topics import DELIVERY, Topic

ids, seqs = st.integers(0, 0xFFFF), st.integers(0, 2**32 - 1)
finite = st.floats(allow_nan=False, allow_infinity=False)
client_messages = st.one_of(
    st.builds(Hello, op=st.just("hello"), proto=st.integers(0, 9)),
    st.builds(
        Subscribe,
        op=st.just("sub"),
        id=ids,
        topic=st.text(min_size=1, max_size=200),
        rate_hz=st.none() | st.floats(0.001, 1000),
        since=st.none() | st.integers(0, 2**53 - 1),
    ),
    st.builds(Unsubscribe, op=st.just("unsub"), id=ids),
    st.builds(Ack, op=st.just("ack"), id=ids, seq=seqs),
    st.builds(Ping, op=st.just("ping"), t=finite),
)
shapes = st.tuples(*[st.integers(0, 12)] * 3)
runs = st.uuids()
slots = st.integers(0, 999)
topics = st.one_of(
    st.builds(Topic, st.sampled_from(["camera", "actions"]), runs, slots),
    st.builds(Topic, st.sampled_from(["metrics", "logs"]), runs, st.none()),
    st.builds(Topic, st.sampled_from(["runs", "topology"]), st.none(), st.none()),
)


@given(client_messages)
def test_what_a_client_says_is_understood(message: ClientMessage) -> None:
    assert protocol.parse_client_message(message.model_dump_json()) == message


@settings(max_examples=300)
@given(
    st.text()
    | st.recursive(
        st.none() | st.booleans() | finite | st.text(), lambda x: st.dictionaries(st.text(), x)
    ).map(json.dumps)
    | st.dictionaries(
        st.sampled_from(["op", "id", "topic", "seq", "since", "rate_hz", "t", "proto"]),
        st.sampled_from(["hello", "sub", "ack", "ping", -1, 2**70, 0.5, None, True, [], {}]),
    ).map(json.dumps)
)
def test_whatever_else_comes_is_refused_with_a_reason(text: str) -> None:
    try:
        message = protocol.parse_client_message(text)
    except ProtocolError:
        return
    assert json.loads(text)["op"] == message.op  # by chance it was none of whatever else


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (
            '{"op":"sub","id":65536,"topic":"runs"}',
            "id: Input should be less than or equal to 65535",
        ),
        ('{"op":"sub","id":true,"topic":"runs"}', "id: Input should be a valid integer"),
        (
            '{"op":"sub","id":1,"topic":"runs","rate_hz":0}',
            "rate_hz: Input should be greater than 0",
        ),
        ('{"op":"sub","id":1,"topic":"runs","colour":1}', "colour: Extra inputs"),
        ('{"op":"shout"}', "Input tag 'shout'"),
        ('{"op":"ping","t":NaN}', "t: "),
        ("x" * 5000, "5000 characters, the limit is 4096"),
    ],
)
def test_a_refusal_names_the_field(text: str, reason: str) -> None:
    with pytest.raises(ProtocolError, match=reason.replace("(", r"\(")):
        protocol.parse_client_message(text)


@given(ids, seqs, finite, st.lists(finite))
def test_server_messages_are_json_with_their_fields(
    subscription: int, seq: int, t_unix_s: float, content: list[float]
) -> None:
    said = json.loads(protocol.data(subscription, seq, t_unix_s, json.dumps(content).encode()))
    assert said == {
        "op": "data",
        "id": subscription,
        "seq": seq,
        "t_unix_s": t_unix_s,
        "data": content,
    }
    assert json.loads(protocol.gap(subscription, None)) == {
        "op": "gap",
        "id": subscription,
        "missed": None,
    }
    assert json.loads(protocol.error(None, "no")) == {"op": "error", "id": None, "title": "no"}
    assert json.loads(protocol.pong(t_unix_s, 2.0)) == {
        "op": "pong",
        "t": t_unix_s,
        "now_unix_s": 2.0,
    }
    assert json.loads(protocol.welcome("d-1", 2.0)) == {
        "op": "welcome", "proto": 1, "server": "d-1", "now_unix_s": 2.0,
    }  # fmt: skip
    assert json.loads(protocol.pong(math.nan, 2.0))["t"] is None  # never NaN, which is no JSON


@given(ids, seqs, finite, finite, shapes, st.integers(1, 4), st.data())
def test_frames_survive_the_wire_and_cut_ones_are_refused(
    subscription: int, seq: int, capture_s: float, hub_s: float, shape: tuple[int, int, int],
    stacked: int, data: st.DataObject,
) -> None:  # fmt: skip
    pixels = data.draw(st.binary(min_size=math.prod(shape), max_size=math.prod(shape)))
    frame = LiveFrame(subscription, seq, capture_s, hub_s, *shape, stacked)
    message = frame.encode(pixels)
    assert len(message) == 32 + len(pixels)
    assert LiveFrame.decode(message) == (frame, pixels)
    for damaged in (message[: data.draw(st.integers(0, len(message) - 1))], message + b"\0"):
        with pytest.raises(ProtocolError):
            LiveFrame.decode(damaged)
    with pytest.raises(ProtocolError, match="version 2"):
        LiveFrame.decode(b"\2" + message[1:])


def test_the_header_is_the_documented_one() -> None:
    frame = LiveFrame(0x0102, 0x03040506, 1.0, -2.0, 1, 2, 3, 1)
    assert frame.encode(bytes(6)).hex() == (
        "01" "01" "0201" "06050403" "000000000000f03f" "00000000000000c0" "0100" "0200" "0300" "0100"
        "000000000000"
    )  # fmt: skip


@given(topics)
def test_a_topic_is_found_by_its_name(topic: Topic) -> None:
    assert Topic.parse(str(topic)) == topic
    assert topic.kind in DELIVERY


@given(st.text() | topics.map(lambda topic: f"{topic}/x") | topics.map(lambda t: str(t)[:-1]))
def test_other_names_are_refused_or_mean_exactly_themselves(name: str) -> None:
    try:
        topic = Topic.parse(name)
    except ProtocolError:
        return
    assert str(topic) == name


def test_no_name_leads_out_of_the_runs() -> None:
    run = UUID(int=1)
    for name in ("logs/..", f"logs/{run}/..", f"logs/{run}\n", "logs/%2e%2e", f"camera/{run}/00"):
        with pytest.raises(ProtocolError, match="there are camera/RUN/SLOT"):
            Topic.parse(name)
