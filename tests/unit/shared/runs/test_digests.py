import contextlib
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_shared.runs.digests import (
    DamagedError,
    arrays_digest,
    seal,
    seal_line,
    unseal,
    unseal_line,
)

NAMES = st.text(min_size=1, max_size=8).filter(lambda name: name != "sha256")
VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**70), 2**70)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(NAMES, inner, max_size=3),
    max_leaves=8,
)
RECORDS = st.dictionaries(NAMES, VALUES, min_size=1, max_size=5)


@given(RECORDS)
def test_what_was_written_is_read(record: dict[str, object]) -> None:
    assert unseal(seal(record)) == (record, True)
    assert unseal_line(seal_line(record)) == (record, True)
    assert b"\n" not in seal_line(record)


@given(RECORDS, st.data())
def test_a_flipped_bit_is_damage_or_changes_nothing(
    record: dict[str, object], data: st.DataObject
) -> None:
    for write, read in ((seal, unseal), (seal_line, unseal_line)):
        written = bytearray(write(record))
        position = data.draw(st.integers(0, len(written) - 1))
        written[position] ^= 1 << data.draw(st.integers(0, 7))
        try:
            found, has_digest = read(bytes(written))
        except DamagedError:
            continue
        # Whoever knows that it had a digest sees that it is lost.
        assert not has_digest or found == record


def test_a_document_may_be_laid_out_anew_but_not_changed() -> None:
    document = json.loads(seal({"gamma": 0.99, "tags": ["a", "b"]}))
    other = dict(reversed(document.items()))
    assert unseal(json.dumps(other).encode()) == ({"gamma": 0.99, "tags": ["a", "b"]}, True)
    with pytest.raises(DamagedError, match="changed after it was written"):
        unseal(json.dumps(other | {"gamma": 0.5}).encode())


ODD = [
    b"",
    b"12",
    b"[]",
    b"\xff\xfe\x00",
    b"\x80",
    b'{"a": NaN}',
    b'{"a": -Infinity}',
    b'{"a": 1e999}',
    b'{"a":' * 5000,
    b'{"a": ' + b"[" * 40 + b"]" * 40 + b"}",
    b'{"a": ' + b"9" * 5000 + b"}",
]


@pytest.mark.parametrize("data", ODD)
def test_any_bytes_are_damage_and_no_other_error(data: bytes) -> None:
    for read in (unseal, unseal_line):
        with pytest.raises(DamagedError):
            read(data)


def test_a_document_is_no_more_than_32_objects_and_lists_deep() -> None:
    def nested(depth: int) -> bytes:
        return b'{"a": ' * (depth - 1) + b"{}" + b"}" * (depth - 1)

    assert unseal(nested(32))[1] is False
    with pytest.raises(DamagedError, match="nested more than 32 deep"):
        unseal(nested(33))


@given(st.binary(max_size=60))
def test_any_bytes_are_read_or_damage(data: bytes) -> None:
    for read in (unseal, unseal_line):
        with contextlib.suppress(DamagedError):
            assert isinstance(read(data)[0], dict)


def test_what_is_not_finite_is_not_written() -> None:
    for write in (seal, seal_line):
        with pytest.raises(ValueError, match="JSON compliant"):
            write({"loss": float("nan")})


def test_the_digest_of_arrays_is_of_all_that_makes_them_and_not_of_their_order() -> None:
    arrays = [("a", "float32", (2, 1), b"12345678"), ("b", "int32", (), b"1234")]
    digest = arrays_digest(arrays)
    assert digest == arrays_digest(reversed(arrays))
    others = [
        [("a", "float32", (1, 2), b"12345678"), arrays[1]],
        [("a", "int32", (2, 1), b"12345678"), arrays[1]],
        [("c", "float32", (2, 1), b"12345678"), arrays[1]],
        [("a", "float32", (2, 1), b"12345679"), arrays[1]],
        arrays[:1],
    ]
    assert len({digest, *map(arrays_digest, others)}) == 6
