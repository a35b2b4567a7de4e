from dataclasses import replace

import numpy as np
import pytest
from geometries import geometries, shapes
from hypothesis import given, settings
from hypothesis import strategies as st

from bpn.testing import check_kernel
from bpn.testing.kernel import (
    IMAGES,
    SIGNS,
    assert_exact,
    make_image,
    with_edge_thresholds,
    with_signs,
    with_ties,
)
from bpn_edge.kernel import Kernel
from bpn_edge.kernel.golden import GoldenKernel
from bpn_edge.kernel.native import NativeKernel, available_paths
from bpn_shared.bnn.blob import Parameters, WeightBlob
from bpn_shared.bnn.golden import Integers, Observation
from bpn_shared.spec.network import Convolution, NetworkSpec

PATHS = {path: NativeKernel(path) for path in available_paths()}
ANY_SHAPE = {path: NativeKernel(path, any_shape=True) for path in available_paths()}

specs = geometries((1, 3, 6), 256, 64)
images = st.sampled_from(IMAGES)
signs = st.sampled_from(SIGNS)


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


@settings(max_examples=30, deadline=None)
@given(spec=specs)
def test_a_network_takes_memory_by_its_size(spec: NetworkSpec) -> None:
    blob = WeightBlob.random(spec, np.random.default_rng(0))
    (kernel,) = (PATHS[path] for path in available_paths()[:1])
    kernel.load(blob)
    padding = 3072  # outputs in blocks of eight, conv1's signs in bytes
    assert len(kernel.network.memory()) < 1.5 * len(blob.encode()) + padding


@settings(max_examples=60, deadline=None)
@given(spec=specs, seed=st.integers(0, 2**32), image_kind=images, tied_layer=st.integers(0, 3))
def test_the_code_for_any_shape_runs_the_papers_too(
    spec: NetworkSpec, seed: int, image_kind: str, tied_layer: int
) -> None:
    rng = np.random.default_rng(seed)
    image = make_image(image_kind, spec, rng)
    blob = with_ties(WeightBlob.random(spec, rng), image, tied_layer, rng)
    for kernel in ANY_SHAPE.values():
        assert_exact(kernel, blob, image)


@settings(max_examples=200, deadline=None)
@given(
    spec=shapes(image_px=64, outputs=40, hidden_units=150),
    seed=st.integers(0, 2**32),
    image_kind=images,
    sign_kinds=st.lists(signs, min_size=6, max_size=6),
    edges=st.booleans(),
    tied_layer=st.sampled_from([None, 0, 1, 2, 3, 4]),
)
def test_every_path_equals_the_reference_in_any_shape(
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
    blob = with_signs(WeightBlob.random(spec, rng), sign_kinds[: len(spec.layers)])
    if edges:
        blob = with_edge_thresholds(blob, rng)
    if tied_layer is not None:
        blob = with_ties(blob, image, tied_layer % (len(spec.layers) - 1), rng)
    for kernel in PATHS.values():
        assert_exact(kernel, blob, image)


LARGEST = [
    NetworkSpec(16, 1024, 64, (Convolution(16, 16, 128), Convolution(8, 1, 128)), 128),
    NetworkSpec(16, 8, 2, (Convolution(16, 8, 128),) + (Convolution(1, 1, 128),) * 5, 128),
    NetworkSpec(4, 512, 6, (Convolution(8, 4, 32), Convolution(4, 2, 64), Convolution(3, 1, 64))),
]


@pytest.mark.parametrize("spec", LARGEST, ids=str)
@pytest.mark.parametrize("path", PATHS)
def test_the_largest_layers_are_exact(path: str, spec: NetworkSpec) -> None:
    """With the largest sums that there can be: the 16-bit sums of some paths just hold them."""
    rng = np.random.default_rng(8)
    for kinds in (["all +1", "random"], ["all -1", "all -1"], ["random", "random"]):
        signs = [*kinds, *["random"] * (len(spec.layers) - 2)]
        blob = with_signs(WeightBlob.random(spec, rng), signs)
        image = make_image("full", spec, rng)
        assert_exact(PATHS[path], with_ties(blob, image, 0, rng), image)


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


@pytest.mark.parametrize("path", [*PATHS, None])
def test_our_own_kernels_pass_what_others_are_held_to(path: str | None) -> None:
    check_kernel(GoldenKernel() if path is None else NativeKernel(path), networks=30)


class Saturating(GoldenKernel):
    """Computes in 16 bits."""

    def run(self, observation: Observation) -> Integers:
        return super().run(observation).clip(-100, 100)


class Forgetful(GoldenKernel):
    """Has one buffer for its outputs."""

    buffer: Integers | None = None

    def run(self, observation: Observation) -> Integers:
        outputs = super().run(observation)
        if self.buffer is None or self.buffer.shape != outputs.shape:
            self.buffer = outputs
        self.buffer[:] = outputs
        return self.buffer


class Reversed(GoldenKernel):
    """Keeps its thresholds in another order."""

    def read_back(self) -> Parameters:
        return {name: values[::-1] for name, values in super().read_back().items()}


class Careless(GoldenKernel):
    """Takes any picture."""

    def run(self, observation: Observation) -> Integers:
        assert self._blob is None or observation.ndim == 3
        shape = None if self._blob is None else self._blob.spec.observation_shape
        return super().run(
            observation if shape is None else np.resize(observation, shape).astype(np.uint8)
        )


class Wrong(NativeKernel):
    """Traces another layer."""

    def trace(self, observation: Observation) -> tuple[tuple[Observation, ...], Integers]:
        activations, outputs = super().trace(observation)
        return (1 - activations[0], *activations[1:]), outputs


@pytest.mark.parametrize(("kernel", "what"), [
    (Saturating(), r"run\(\)"),
    (Forgetful(), "overwrites outputs"),
    (Reversed(), r"read_back\(\), (weights|thresholds)"),
    (Careless(), r"run\(\) of float32.* does not raise ValueError"),
    (Wrong(), r"trace\(\), conv1"),
])  # fmt: skip
def test_faults_of_a_kernel_are_named(kernel: Kernel, what: str) -> None:
    with pytest.raises(AssertionError, match=f"kernel '(golden|native)'.*{what}"):
        check_kernel(kernel, networks=8)
