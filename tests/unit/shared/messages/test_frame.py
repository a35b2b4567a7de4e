"""A frame's bytes: pinned, since robots of other makers write them too, and refused in one line."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_shared.messages.base import MessageError, OtherVersionError
from bpn_shared.messages.frame import (
    NO_ACTION,
    NO_SUCCESS,
    FrameHeader,
    FrameKind,
    decode_frame,
)

HEADER = FrameHeader(
    FrameKind.TERMINATED, iteration=1, episode=2, step=3, reset_id=4, t_capture_ns=5, applied_action=6,
    camera_to_action_ns=7, deadline_misses=8, channels=3, reward=-0.5, success=True,
)  # fmt: skip


def test_the_headers_bytes_are_what_they_always_were() -> None:
    expected = struct.pack("<4B3I3Q2Id", 4, 3, 3, 1, 1, 2, 3, 4, 6, 5, 7, 8, -0.5)
    assert HEADER.encode() == expected
    assert [HEADER._replace(success=s).encode()[3] for s in (None, False, True)] == [255, 0, 1]
    assert (NO_ACTION, NO_SUCCESS) == (2**64 - 1, 255)


@pytest.mark.parametrize(("byte", "action"), [(6, 6), (255, NO_ACTION)])
def test_headers_of_the_schema_before_are_read(byte: int, action: int) -> None:
    older = struct.pack("<5B3x3I2Q2Id", 3, 3, 3, byte, 1, 1, 2, 3, 4, 5, 7, 8, -0.5)
    assert FrameHeader.decode(older) == HEADER._replace(applied_action=action)


@given(st.integers(0, 2**64 - 1))
def test_an_action_of_many_dimensions_has_room(action: int) -> None:
    header = HEADER._replace(applied_action=action)
    assert FrameHeader.decode(header.encode()) == header


def test_what_need_not_be_told_has_a_default() -> None:
    header = FrameHeader(FrameKind.FIRST, 0, 0, 0, 0, 0)
    assert (header.applied_action, header.camera_to_action_ns, header.deadline_misses) == (
        NO_ACTION,
        0,
        0,
    )
    assert (header.channels, header.success) == (1, None)
    assert np.isnan(header.reward)


@pytest.mark.parametrize(
    ("place", "value", "reason"),
    [
        (1, 4, r"kind 4 is none of 0\.\.3"),
        (3, 2, "success 2 is none of 0, 1, 255"),
        (3, 254, "success 254 is none of 0, 1, 255"),
    ],
)
def test_values_that_are_none_are_refused(place: int, value: int, reason: str) -> None:
    data = bytearray(HEADER.encode())
    data[place] = value
    with pytest.raises(MessageError, match=reason):
        FrameHeader.decode(bytes(data))


def test_another_schema_is_told_from_damage() -> None:
    data = HEADER.encode()
    with pytest.raises(OtherVersionError, match="schema 2, this program reads 3 and 4"):
        FrameHeader.decode(b"\x02" + data[1:])
    for wrong in (b"", data[:-1], data + b"x"):
        with pytest.raises(
            MessageError, match=f"{len(wrong)} bytes, expected {len(data)}"
        ) as damage:
            FrameHeader.decode(wrong)
        assert not isinstance(damage.value, OtherVersionError)


shapes = st.tuples(st.integers(1, 4), st.integers(1, 9), st.integers(1, 9))


@given(shapes, st.integers(0, 2**32))
def test_pixels_arrive_in_their_shape(shape: tuple[int, int, int], seed: int) -> None:
    pixels = np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)
    header = HEADER._replace(channels=shape[0])
    found, arrived = decode_frame(header.encode(), pixels.tobytes(), shape)
    assert found == header
    assert arrived.dtype == np.uint8
    np.testing.assert_array_equal(arrived, pixels)


@given(shapes, st.sampled_from(["channels", "fewer", "more"]))
def test_pixels_of_another_shape_are_refused(shape: tuple[int, int, int], wrong: str) -> None:
    size = int(np.prod(shape)) + {"channels": 0, "fewer": -1, "more": 1}[wrong]
    header = HEADER._replace(channels=shape[0] + (wrong == "channels"))
    with pytest.raises(MessageError, match=f"{size} bytes with {header.channels} channels"):
        decode_frame(header.encode(), bytes(size), shape)
