from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from geometries import geometries
from hypothesis import given, settings
from hypothesis import strategies as st

from bpn_edge.kernel.native import NativeKernel, available_paths
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.spec.network import Layer, NetworkSpec

INT32 = np.iinfo(np.int32)
PATHS = {path: NativeKernel(path) for path in available_paths()}

specs = geometries((1, 3, 6), 256, 64)
images = st.sampled_from(["random", "zeros", "full", "black and white"])
signs = st.sampled_from(["random", "random", "all +1", "all -1"])


def make_image(kind: str, spec: NetworkSpec, rng: np.random.Generator) -> npt.NDArray[np.uint8]:
    shape = spec.observation_shape
    if kind == "random":
        return rng.integers(0, 256, shape, dtype=np.uint8)
    if kind == "black and white":
        return rng.choice(np.array([0, 255], np.uint8), shape)
    return np.full(shape, 255 if kind == "full" else 0, np.uint8)


def with_edge_thresholds(blob: WeightBlob, rng: np.random.Generator) -> WeightBlob:
    """Puts about half of the thresholds at or beyond the ends of what o and int32 can reach."""

    def edges(layer: Layer, tau: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
        most = layer.max_output
        ends = (INT32.min, INT32.min + 1, -most - 1, -most, -most + 1, most, most + 1, INT32.max)
        return np.where(
            rng.random(tau.shape) < 0.5, rng.choice(np.array(ends, np.int32), tau.shape), tau
        ).astype(np.int32)

    thresholds = zip(blob.spec.layers[:-1], blob.thresholds, strict=True)
    return replace(blob, thresholds=tuple(edges(layer, tau) for layer, tau in thresholds))


def with_ties(
    blob: WeightBlob, image: npt.NDArray[np.uint8], layer: int, rng: np.random.Generator
) -> WeightBlob:
    """Puts each threshold of a layer at an o that occurs in its channel, or one beside it."""
    o = golden.forward(blob, image)[layer]
    by_channel = o.reshape(-1, o.shape[-1])
    occurring = by_channel[rng.integers(len(by_channel)), :]
    thresholds = list(blob.thresholds)
    thresholds[layer] = (occurring + rng.integers(-1, 2, occurring.shape)).astype(np.int32)
    return replace(blob, thresholds=tuple(thresholds))


def with_signs(blob: WeightBlob, kinds: list[str]) -> WeightBlob:
    constants = {"all +1": 1, "all -1": -1}
    weights = (
        np.full_like(w, constants[kind]) if kind in constants else w
        for kind, w in zip(kinds, blob.weights, strict=True)
    )
    return replace(blob, weights=tuple(weights))


def assert_exact(kernel: NativeKernel, blob: WeightBlob, image: npt.NDArray[np.uint8]) -> None:
    """Every activation of every layer and every output equal the reference's."""
    *inner, outputs = golden.forward(blob, image)
    kernel.load(blob)
    activations, traced = kernel.trace(image)
    for layer, o, tau, bits in zip(
        blob.spec.layers, inner, blob.thresholds, activations, strict=False
    ):
        np.testing.assert_array_equal(bits, (o >= tau).reshape(-1), f"{kernel.path} {layer.name}")
    np.testing.assert_array_equal(traced, outputs, kernel.path)
    result = kernel.run(image)
    assert result.dtype == np.int32
    np.testing.assert_array_equal(result, outputs, kernel.path)


@settings(max_examples=1000, deadline=None)
@given(
    spec=specs,
    seed=st.integers(0, 2**32),
    image_kind=images,
    sign_kinds=st.lists(signs, min_size=5, max_size=5),
    edges=st.booleans(),
    tied_layer=st.sampled_from([None, 0, 1, 2, 3]),
)
def test_every_path_equals_the_reference(
    *,
    spec: NetworkSpec,
    seed: int,
    image_kind: str,
    sign_kinds: list[str],
    edges: bool,
    tied_layer: int | None,
) -> None:
    rng = np.random.default_rng(seed)
    image = make_image(image_kind, spec, rng)
    blob = with_signs(WeightBlob.random(spec, rng), sign_kinds)
    if edges:
        blob = with_edge_thresholds(blob, rng)
    if tied_layer is not None:
        blob = with_ties(blob, image, tied_layer, rng)
    for kernel in PATHS.values():
        assert_exact(kernel, blob, image)


@pytest.mark.parametrize("spec", [NetworkSpec(1, 1, 2), NetworkSpec(16, 1024, 64)], ids=str)
@pytest.mark.parametrize("path", PATHS)
def test_the_smallest_and_the_largest_network(path: str, spec: NetworkSpec) -> None:
    rng = np.random.default_rng(7)
    for kind in ("random", "full"):
        assert_exact(PATHS[path], WeightBlob.random(spec, rng), make_image(kind, spec, rng))


@pytest.mark.parametrize("path", PATHS)
def test_the_largest_sums_of_conv1_do_not_saturate(path: str) -> None:
    """Every product is +255, or every one -255, and tau is the sum itself."""
    spec = NetworkSpec(16, 8, 2)
    most = spec.layers[0].max_output
    image = np.full(spec.observation_shape, 255, np.uint8)
    blob = WeightBlob.random(spec, np.random.default_rng(0))
    alternating = np.where(np.arange(8) % 2 == 0, 1, -1).astype(np.int8)
    weights = (np.broadcast_to(alternating[:, None], (8, 1024)).copy(), *blob.weights[1:])
    for offset in (0, 1):
        tau = alternating.astype(np.int32) * most + np.int32(offset)
        tied = replace(blob, weights=weights, thresholds=(tau, *blob.thresholds[1:]))
        assert_exact(PATHS[path], tied, image)


def test_a_portable_path_is_always_there_and_comes_last() -> None:
    assert available_paths()[-1] == "portable"
    assert NativeKernel().path == available_paths()[0]
