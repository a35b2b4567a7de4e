"""What is in a bank is read back: no bit of it can be another than the policy's and go unnoticed."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from geometries import geometries, shapes
from hypothesis import given, settings
from hypothesis import strategies as st

from bpn_edge.kernel import load
from bpn_edge.kernel.native import NativeKernel
from bpn_edge.memory import compare, verify
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob, canonical_thresholds
from bpn_shared.bnn.envelope import BlobError
from bpn_shared.spec.network import NetworkSpec

specs = geometries(range(1, 17), 130, 64) | shapes()
INT32 = np.iinfo(np.int32)


def random_blob(spec: NetworkSpec, seed: int) -> WeightBlob:
    rng = np.random.default_rng(seed)
    blob = WeightBlob.random(spec, rng)
    far = [rng.choice([INT32.min, INT32.max, *range(-3, 4)], tau.shape) for tau in blob.thresholds]
    mixed = zip(blob.thresholds, far, strict=True)
    return replace(
        blob,
        thresholds=tuple(
            np.where(rng.random(tau.shape) < 0.3, other, tau).astype(np.int32)
            for tau, other in mixed
        ),
    )


@given(specs, st.integers(0, 2**32), st.sampled_from(["native", "golden"]))
@settings(max_examples=40)
def test_what_was_loaded_is_read_back(spec: NetworkSpec, seed: int, name: str) -> None:
    blob, kernel = random_blob(spec, seed), load(name)
    kernel.load(blob)
    verify(kernel, blob)
    found = kernel.read_back()
    assert list(found) == [
        *(f"weights of {layer.name}" for layer in spec.layers),
        *(f"thresholds of {layer.name}" for layer in spec.layers[:-1]),
    ]
    for layer, signs in zip(spec.layers, blob.weights, strict=True):
        np.testing.assert_array_equal(found[f"weights of {layer.name}"], signs)


@given(st.integers(0, 2**32), st.data())
@settings(max_examples=30)
def test_read_back_thresholds_decide_as_the_policys_do(seed: int, data: st.DataObject) -> None:
    blob = random_blob(NetworkSpec(2, 40, 5), seed)
    for layer, tau in zip(blob.spec.layers[:-1], blob.thresholds, strict=True):
        most = layer.max_output
        sums = np.arange(-most, most + 1, 1 if layer.max_input > 1 else 2)  # all that can occur
        canonical = canonical_thresholds(layer, tau)
        k = data.draw(st.integers(0, len(tau) - 1))
        np.testing.assert_array_equal(sums >= tau[k], sums >= canonical[k])
        again = canonical_thresholds(layer, canonical)
        np.testing.assert_array_equal(again, canonical)
    changed = tuple(
        canonical_thresholds(layer, tau)
        for layer, tau in zip(blob.spec.layers[:-1], blob.thresholds, strict=True)
    )
    image = np.random.default_rng(seed).integers(
        0, 256, blob.spec.observation_shape, dtype=np.uint8
    )
    for before, after in zip(
        golden.forward(blob, image),
        golden.forward(replace(blob, thresholds=changed), image),
        strict=True,
    ):
        np.testing.assert_array_equal(before, after)


BLOB = random_blob(NetworkSpec(6, 100, 17), 0)
KERNEL = NativeKernel()
KERNEL.load(BLOB)
BANK_BITS = 8 * len(KERNEL.network.memory())


@given(st.integers(0, BANK_BITS - 1))
@settings(max_examples=300)
def test_any_flipped_bit_of_the_native_bank_is_noticed(bit: int) -> None:
    """All of it: weights, thresholds and padding, which the arithmetic may read too."""
    bank, checksum = KERNEL.network.memory(), KERNEL.checksum()
    bank[bit // 8] ^= 1 << bit % 8
    try:
        assert KERNEL.checksum() != checksum
        with pytest.raises(BlobError, match="memory"):
            compare(KERNEL, BLOB)
    finally:
        bank[bit // 8] ^= 1 << bit % 8
    assert KERNEL.checksum() == checksum
    compare(KERNEL, BLOB)


def flipped(blob: WeightBlob, layer: int, index: int) -> WeightBlob:
    weights = [signs.copy() for signs in blob.weights]
    weights[layer].flat[index % weights[layer].size] *= -1
    return replace(blob, weights=tuple(weights))


def raised(blob: WeightBlob, layer: int, index: int) -> WeightBlob:
    """By two, so that it decides otherwise of sums that are all odd or all even."""
    thresholds = [tau.copy() for tau in blob.thresholds]
    spec, k = blob.spec.layers[layer % 4], index % len(thresholds[layer % 4])
    tau = int(canonical_thresholds(spec, thresholds[layer % 4])[k])
    thresholds[layer % 4][k] = tau - 2 if tau > 0 else tau + 2
    return replace(blob, thresholds=tuple(thresholds))


@given(
    st.integers(0, 4), st.integers(0, 2**31), st.sampled_from(["native", "golden"]),
    st.sampled_from([flipped, raised]),
)  # fmt: skip
@settings(max_examples=60)
def test_any_one_wrong_parameter_is_noticed_and_named(
    layer: int, index: int, name: str, change: Callable[[WeightBlob, int, int], WeightBlob]
) -> None:
    """Such as packing would make if it were wrong."""
    kernel = load(name)
    kernel.load(change(BLOB, layer, index))
    names = [part.name for part in BLOB.spec.layers]
    what = (
        f"weights of {names[layer]}" if change is flipped else f"thresholds of {names[layer % 4]}"
    )
    with pytest.raises(BlobError, match=f"1 of [0-9]+ {what} differ in the {name} kernel's memory"):
        verify(kernel, BLOB)


def test_another_geometry_is_noticed() -> None:
    kernel = NativeKernel()
    kernel.load(random_blob(NetworkSpec(6, 101, 17), 0))
    with pytest.raises(BlobError, match="holds other weights of fc1"):
        verify(kernel, BLOB)


def test_wrong_arithmetic_on_right_parameters_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    kernel = load("golden")
    kernel.load(BLOB)
    right = type(kernel).run
    monkeypatch.setattr(type(kernel), "run", lambda self, image: right(self, image) + np.int32(2))
    with pytest.raises(BlobError, match="computes it wrongly"):
        verify(kernel, BLOB)


@pytest.mark.parametrize("name", ["native", "golden", "onnx"])
def test_a_kernel_without_weights_has_nothing_to_read_back(name: str) -> None:
    for method in ("read_back", "checksum"):
        with pytest.raises(RuntimeError, match="has no weights"):
            getattr(load(name), method)()
