import hashlib
import struct
from dataclasses import replace
from uuid import UUID

import numpy as np
import pytest
from geometries import geometries
from hypothesis import given, settings
from hypothesis import strategies as st

from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bnn.envelope import BlobError
from bpn_shared.bnn.float_weights import FloatWeights, max_encoded_size, max_model_bytes
from bpn_shared.bnn.weights import decode_weights, max_weights_bytes, network_kind
from bpn_shared.spec.network import NetworkSpec

specs = geometries((1, 3, 6), 256, 64)
versions = st.integers(0, 2**32 - 1)
policies = st.builds(
    lambda spec, model, seed, run, attempt, version: FloatWeights(
        spec,
        model,
        np.random.default_rng(seed).normal(size=spec.actions).astype(np.float32),
        run,
        attempt,
        version,
    ),
    specs,
    st.binary(min_size=1, max_size=300),  # nothing looks into the model here
    st.integers(0, 2**32),
    st.uuids(),
    versions,
    versions,
)
SMALL = FloatWeights(NetworkSpec(1, 8, 4), b"model", np.arange(4, dtype=np.float32))


@given(policies)
def test_decode_returns_what_was_encoded(policy: FloatWeights) -> None:
    decoded = decode_weights(policy.encode())
    assert isinstance(decoded, FloatWeights)
    assert (decoded.spec, decoded.model) == (policy.spec, policy.model)
    assert (decoded.run, decoded.attempt, decoded.version) == (
        policy.run,
        policy.attempt,
        policy.version,
    )
    np.testing.assert_array_equal(decoded.probe_outputs, policy.probe_outputs)
    assert network_kind(decoded) == "float"
    assert len(policy.encode()) <= max_weights_bytes("float", policy.spec)


def test_a_weight_blob_is_told_apart() -> None:
    blob = WeightBlob.random(NetworkSpec(1, 8, 4), np.random.default_rng(0))
    decoded = decode_weights(blob.encode())
    assert isinstance(decoded, WeightBlob)
    assert network_kind(decoded) == "binary"
    assert len(blob.encode()) == max_weights_bytes("binary", blob.spec)
    with pytest.raises(BlobError, match="a weight blob starts with b'BPNW'"):
        WeightBlob.decode(SMALL.encode() + bytes(100))
    with pytest.raises(BlobError, match="a float policy starts with b'BPNF'"):
        FloatWeights.decode(blob.encode())


@given(policies, st.data())
def test_any_flipped_bit_is_refused(policy: FloatWeights, data: st.DataObject) -> None:
    encoded = bytearray(policy.encode())
    bit = data.draw(st.integers(0, 8 * len(encoded) - 1))
    encoded[bit // 8] ^= 1 << (bit % 8)
    with pytest.raises(BlobError):
        decode_weights(bytes(encoded))


@given(policies, st.integers(0, 2**31), st.binary(min_size=1, max_size=64))
def test_truncated_and_oversized_are_refused(policy: FloatWeights, cut: int, extra: bytes) -> None:
    encoded = policy.encode()
    with pytest.raises(BlobError):
        decode_weights(encoded[: cut % len(encoded)])
    with pytest.raises(BlobError, match="the header tells of"):
        decode_weights(encoded + extra)


@settings(max_examples=300)
@given(st.sampled_from([b"", b"BPNW", b"BPNF", b"BPNF\x01\x00"]), st.binary(max_size=4096))
def test_noise_is_refused(start: bytes, noise: bytes) -> None:
    with pytest.raises(BlobError):
        decode_weights(start + noise)


def signed(header: bytes, rest: bytes) -> bytes:
    return header + rest + hashlib.sha256(header + rest).digest()


def header(**changes: int) -> bytes:
    fields = {"schema": 1, "channels": 1, "hidden_units": 8, "actions": 2, "model": 5} | changes
    return struct.pack(
        "<4sHHHH16sIII", b"BPNF", fields["schema"], fields["channels"], fields["hidden_units"],
        fields["actions"], bytes(16), 0, 0, fields["model"],
    )  # fmt: skip


def test_whole_but_wrong_contents_are_named() -> None:
    answer = np.zeros(2, "<f4").tobytes()
    assert isinstance(decode_weights(signed(header(), answer + b"model")), FloatWeights)
    with pytest.raises(BlobError, match="float policy schema 3, this program reads 1 and 2"):
        decode_weights(signed(header(schema=3), answer + b"model"))
    with pytest.raises(BlobError, match=r"hidden_units = 0 is outside 1\.\.1024"):
        decode_weights(signed(header(hidden_units=0), answer + b"model"))
    with pytest.raises(BlobError, match="model of 0 bytes"):
        decode_weights(signed(header(model=0), answer))
    with pytest.raises(BlobError, match="probe_outputs are not finite"):
        decode_weights(signed(header(), np.array([0, np.nan], "<f4").tobytes() + b"model"))
    limit = max_model_bytes(NetworkSpec(1, 8, 2))
    with pytest.raises(BlobError, match=f"model of {limit + 1} bytes"):
        decode_weights(signed(header(model=limit + 1), answer + bytes(limit + 1)))


def test_parts_of_another_geometry_are_refused() -> None:
    with pytest.raises(BlobError, match=r"probe_outputs are float32\[5\]"):
        replace(SMALL, probe_outputs=np.zeros(5, np.float32))
    with pytest.raises(BlobError, match="probe_outputs are float64"):
        replace(SMALL, probe_outputs=np.zeros(4))
    with pytest.raises(BlobError, match="attempt = -1"):
        replace(SMALL, attempt=-1)


def test_a_paper_sized_float_policy_is_a_third_of_a_megabyte() -> None:
    spec = NetworkSpec(6, 100, 17)
    parameters = 87_524 + (8 + 16 + 16 + 100 + 17)
    assert 4 * parameters < max_encoded_size(spec) < 4 * parameters + 20_000


@given(policies, st.uuids())
def test_content_digest_ignores_provenance_and_nothing_else(
    policy: FloatWeights, run: UUID
) -> None:
    renamed = replace(policy, run=run, attempt=1, version=2)
    assert renamed.content_sha256() == policy.content_sha256()
    changed = replace(policy, model=policy.model[:-1] + bytes([policy.model[-1] ^ 1]))
    assert changed.content_sha256() != policy.content_sha256()
