import hashlib
import struct
from dataclasses import replace
from pathlib import Path
from uuid import UUID

import numpy as np
import pytest
from geometries import geometries, shapes
from hypothesis import given
from hypothesis import strategies as st
from older_blobs import dense

from bpn_shared.bnn.blob import WeightBlob, encoded_size
from bpn_shared.bnn.envelope import BlobError
from bpn_shared.spec.network import NetworkSpec

GOLDEN = Path(__file__).parents[3] / "golden/schema-1/01a21e2b-4a1d-7550-8c36-dce4819c20af/weights"
specs = geometries((1, 3, 6), 256, 64) | shapes()
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


def test_paper_sized_policy_is_twelve_kilobytes() -> None:
    spec = NetworkSpec(6, 100, 17)
    assert spec.weight_bits == 87_524  # independently: 3072 + 2048 + 2304 + 78400 + 1700
    assert spec.macs == 1_587_684
    header, digest = 128, 32  # 48 + 5 rows of 8 + 2, and up to a multiple of 64
    signs = (
        8 * 48 + 16 * 16 + (16 * 20) + 100 * 100 + 48 + (17 * 16) + 48
    )  # and 48 bytes of padding, twice
    thresholds = 64 + 64 + 64 + 448
    assert encoded_size(spec) == header + signs + thresholds + digest


@given(geometries((1, 3, 6), 256, 64), st.integers(0, 2**32), st.uuids())
def test_schema_1_is_read_for_ever(spec: NetworkSpec, seed: int, run: UUID) -> None:
    blob = replace(
        WeightBlob.random(spec, np.random.default_rng(seed)), run=run, attempt=3, version=seed % 99
    )
    decoded = WeightBlob.decode(dense(blob))
    assert decoded.encode() == blob.encode()
    assert decoded.content_sha256() == blob.content_sha256()


@pytest.mark.parametrize("path", sorted(GOLDEN.glob("*.bpnw")), ids=lambda path: path.stem)
def test_blobs_that_the_first_program_wrote_are_what_they_were(path: Path) -> None:
    """The digest of what a policy computes does not change with the form in which it is written."""
    data = path.read_bytes()
    assert data[4:6] == b"\1\0"
    blob = WeightBlob.decode(data)
    assert dense(blob) == data
    expected = hashlib.sha256(data[6:12] + data[36:-32]).hexdigest()
    assert blob.content_sha256() == WeightBlob.decode(blob.encode()).content_sha256() == expected


@given(shapes(), st.data())
def test_other_shapes_with_the_same_bits_have_another_digest(
    spec: NetworkSpec, data: st.DataObject
) -> None:
    """Of layers that differ in stride or in the image alone, signs and thresholds may be the same."""
    blob = WeightBlob.random(spec, np.random.default_rng(0))
    single = replace(spec, action_dims=())
    if single != spec:
        assert replace(blob, spec=single).content_sha256() != blob.content_sha256()
    *_, last = spec.convolutions
    before = spec.layers[len(spec.convolutions) - 1].in_size
    stride = data.draw(st.integers(1, last.kernel))
    if (
        stride != last.stride
        and (before - last.kernel) // stride == (before - last.kernel) // last.stride
    ):
        other = replace(spec, convolutions=(*spec.convolutions[:-1], last._replace(stride=stride)))
        assert replace(blob, spec=other).content_sha256() != blob.content_sha256()


@given(shapes(), st.data())
def test_bytes_between_the_sections_are_zero(spec: NetworkSpec, data: st.DataObject) -> None:
    """A digest that is right does not make them mean something."""
    blob = WeightBlob.random(spec, np.random.default_rng(0))
    full = replace(
        blob,
        weights=tuple(np.ones_like(w) for w in blob.weights),
        thresholds=tuple(np.full_like(tau, -1) for tau in blob.thresholds),
    )
    encoded = bytearray(full.encode()[:-32])
    zero = [at for at in range(44, len(encoded)) if encoded[at] == 0 and (at < 48 or at >= 192)]
    at = data.draw(st.sampled_from(zero))
    encoded[at] |= 0x80
    with pytest.raises(BlobError, match="zero"):
        WeightBlob.decode(bytes(encoded) + hashlib.sha256(encoded).digest())


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


@given(geometries((1, 3, 6), 256, 64))
def test_a_probe_is_an_observation_and_always_the_same(spec: NetworkSpec) -> None:
    probe = spec.probe()
    assert (probe.dtype, probe.shape) == (np.uint8, spec.observation_shape)
    assert (probe.min(), probe.max()) == (0, 255)
    np.testing.assert_array_equal(probe, spec.probe())


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
    [
        (0, b"BPNX", "starts with b'BPNX'"),
        (4, b"\x03\x00", "blob schema 3, this program reads 1 and 2"),
    ],
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
