import hashlib
import struct
from dataclasses import replace
from uuid import UUID

import numpy as np
import pytest
from geometries import geometries
from hypothesis import given
from hypothesis import strategies as st

from bpn_shared.bnn.blob import WeightBlob, encoded_size
from bpn_shared.bnn.envelope import BlobError
from bpn_shared.spec.network import NetworkSpec

specs = geometries((1, 3, 6), 256, 64)
blobs = st.builds(
    lambda spec, seed, run, attempt, version: replace(
        WeightBlob.random(spec, np.random.default_rng(seed)),
        run=run,
        attempt=attempt,
        version=version,
    ),
    specs,
    st.integers(0, 2**32),
    st.uuids(),
    st.integers(0, 2**32 - 1),
    st.integers(0, 2**32 - 1),
)
SMALL = WeightBlob.random(NetworkSpec(1, 8, 4), np.random.default_rng(0))


@given(blobs)
def test_decode_returns_what_was_encoded(blob: WeightBlob) -> None:
    decoded = WeightBlob.decode(blob.encode())
    assert decoded.spec == blob.spec
    assert (decoded.run, decoded.attempt, decoded.version) == (
        blob.run,
        blob.attempt,
        blob.version,
    )
    assert decoded.scale == blob.scale
    for ours, theirs in zip(
        (*blob.weights, *blob.thresholds), (*decoded.weights, *decoded.thresholds), strict=True
    ):
        np.testing.assert_array_equal(ours, theirs)


@given(specs, st.integers(0, 2**32))
def test_thresholds_at_and_beyond_every_limit_survive(spec: NetworkSpec, seed: int) -> None:
    blob, rng = WeightBlob.random(spec, np.random.default_rng(0)), np.random.default_rng(seed)
    int32 = np.iinfo(np.int32)
    thresholds = []
    for layer in spec.layers[:-1]:
        most = layer.max_output
        ends = [
            int32.min,
            -most - 1,
            -most,
            -32769,
            -32768,
            32767,
            32768,
            most,
            most + 1,
            int32.max,
        ]
        thresholds.append(rng.choice(np.array(ends, np.int32), layer.out_channels))
    decoded = WeightBlob.decode(replace(blob, thresholds=tuple(thresholds)).encode())
    for ours, theirs in zip(thresholds, decoded.thresholds, strict=True):
        np.testing.assert_array_equal(ours, theirs)


@given(blobs)
def test_size_is_known_before(blob: WeightBlob) -> None:
    assert len(blob.encode()) == encoded_size(blob.spec)


def test_paper_sized_policy_is_eleven_kilobytes() -> None:
    spec = NetworkSpec(6, 100, 17)
    assert spec.weight_bits == 87_524  # independently: 3072 + 2048 + 2304 + 78400 + 1700
    assert spec.macs == 1_587_684
    assert 10_900 < encoded_size(spec) < 11_800


def test_layers_are_the_papers() -> None:
    """Kernel, stride, sizes; the largest sum is of a picture that is white where the signs are plus."""
    found = [
        (a.in_size, a.kernel, a.stride, a.out_size, a.weight_shape, a.max_output)
        for a in NetworkSpec(6, 100, 17).layers
    ]
    names = [layer.name for layer in NetworkSpec(6, 100, 17).layers]
    assert names == ["conv1", "conv2", "conv3", "fc1", "fc2"]
    assert found == [
        (84, 8, 4, 20, (8, 384), 384 * 255),
        (20, 4, 2, 9, (16, 128), 128),
        (9, 3, 1, 7, (16, 144), 144),
        (7, 7, 1, 1, (100, 784), 784),
        (1, 1, 1, 1, (17, 100), 100),
    ]


@given(blobs)
def test_a_probe_is_an_observation_and_always_the_same(blob: WeightBlob) -> None:
    probe = blob.spec.probe()
    assert (probe.dtype, probe.shape) == (np.uint8, blob.spec.observation_shape)
    assert (probe.min(), probe.max()) == (0, 255)
    np.testing.assert_array_equal(probe, blob.spec.probe())


@given(blobs, st.data())
def test_any_flipped_bit_is_refused(blob: WeightBlob, data: st.DataObject) -> None:
    encoded = bytearray(blob.encode())
    bit = data.draw(st.integers(0, 8 * len(encoded) - 1))
    encoded[bit // 8] ^= 1 << (bit % 8)
    with pytest.raises(BlobError):
        WeightBlob.decode(bytes(encoded))


@given(st.integers(0, 2**31), st.binary(max_size=64))
def test_truncated_and_oversized_are_refused(cut: int, extra: bytes) -> None:
    encoded = SMALL.encode()
    with pytest.raises(BlobError):
        WeightBlob.decode(encoded[: cut % len(encoded)])
    if extra:
        with pytest.raises(BlobError, match="the header tells of"):
            WeightBlob.decode(encoded + extra)


@given(st.binary(max_size=4096))
def test_noise_is_refused(noise: bytes) -> None:
    with pytest.raises(BlobError):
        WeightBlob.decode(noise)


def test_a_wrong_geometry_names_the_value() -> None:
    header = struct.pack("<4sHHHH16sIIf", b"BPNW", 1, 1, 0, 4, bytes(16), 0, 0, 1.0)
    with pytest.raises(BlobError, match=r"hidden_units = 0 is outside 1\.\.1024"):
        WeightBlob.decode(header + bytes(100))


@pytest.mark.parametrize(
    ("place", "value", "reason"),
    [(0, b"BPNX", "starts with b'BPNX'"), (4, b"\x02\x00", "blob schema 2, this program reads 1")],
)
def test_another_format_is_refused_although_its_digest_is_right(
    place: int, value: bytes, reason: str
) -> None:
    data = bytearray(SMALL.encode()[:-32])
    data[place : place + len(value)] = value
    with pytest.raises(BlobError, match=reason):
        WeightBlob.decode(bytes(data) + hashlib.sha256(data).digest())


@pytest.mark.parametrize("scale", [0.0, -1.0, float("nan"), float("inf"), 1e-60])
def test_a_scale_that_is_no_positive_float32_is_refused(scale: float) -> None:
    with pytest.raises(BlobError, match="scale"):
        replace(SMALL, scale=scale)


@pytest.mark.parametrize("name", ["attempt", "version"])
def test_provenance_is_an_unsigned_32_bit_number(name: str) -> None:
    for value in (0, 2**32 - 1):
        given = replace(SMALL, **{name: value})
        assert getattr(WeightBlob.decode(given.encode()), name) == value
    for value in (-1, 2**32):
        with pytest.raises(BlobError, match=f"{name} = {value} is outside 0..4294967295"):
            replace(SMALL, **{name: value})


def test_parts_of_another_geometry_are_refused() -> None:
    with pytest.raises(BlobError, match="weights"):
        replace(SMALL, weights=SMALL.weights[:-1])
    with pytest.raises(BlobError, match="thresholds"):
        replace(SMALL, thresholds=tuple(t.astype(np.int64) for t in SMALL.thresholds))
    with pytest.raises(BlobError, match="other than -1 and \\+1"):
        replace(SMALL, weights=(SMALL.weights[0] * 0, *SMALL.weights[1:]))


@given(blobs, st.uuids())
def test_content_digest_ignores_provenance_and_nothing_else(blob: WeightBlob, run: UUID) -> None:
    assert replace(blob, run=run, attempt=1, version=2).content_sha256() == blob.content_sha256()
    flipped = (-blob.weights[0], *blob.weights[1:])
    assert replace(blob, weights=flipped).content_sha256() != blob.content_sha256()
    raised = (*blob.thresholds[:-1], blob.thresholds[-1] + np.int32(1))
    assert replace(blob, thresholds=raised).content_sha256() != blob.content_sha256()
    assert replace(blob, scale=blob.scale * 2).content_sha256() != blob.content_sha256()


@pytest.mark.parametrize(
    ("name", "low", "high"), [("channels", 1, 16), ("hidden_units", 1, 1024), ("actions", 2, 64)]
)
def test_a_networks_sizes_have_exactly_these_limits(name: str, low: int, high: int) -> None:
    sizes = {"channels": 1, "hidden_units": 8, "actions": 4}
    for value in (low, high):
        spec = NetworkSpec(**sizes | {name: value})
        assert (
            WeightBlob.decode(WeightBlob.random(spec, np.random.default_rng(0)).encode()).spec
            == spec
        )
    for value in (low - 1, high + 1):
        with pytest.raises(ValueError, match=f"{name} = {value} is outside {low}..{high}"):
            NetworkSpec(**sizes | {name: value})
