"""A kernel beside the golden model: random networks, and thresholds chosen to trip it up."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from bpn_edge.kernel import Kernel
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bnn.golden import Observation
from bpn_shared.spec.network import MAX_KERNEL, Convolution, Layer, NetworkSpec

INT32 = np.iinfo(np.int32)
IMAGES = ("random", "zeros", "full", "black and white")
SIGNS = ("random", "random", "all +1", "all -1")
SMALLEST, LARGEST = NetworkSpec(1, 1, 2), NetworkSpec(16, 1024, 64)


def check_kernel(
    kernel: Kernel, *, networks: int = 100, seed: int = 0, largest: NetworkSpec = LARGEST
) -> None:
    """Holds a kernel for binarized policies to `bpn_edge.kernel.Kernel`, and to golden bit by bit.

    Networks of random shape, signs and thresholds, also thresholds that every sum reaches, or none, or that are
    ties; pictures at random, black, white and of both. Where the kernel has `trace(observation) ->
    (activations, outputs)`, as `NativeKernel.trace`, every layer is compared.

    Args:
        kernel: without weights yet.
        networks: random ones, every second of the paper's shape, beside the smallest and the largest.
        seed: of what is drawn.
        largest: network of the paper's shape that it takes, where it is made for that shape alone.

    Raises:
        AssertionError: it differs; the message names what, and the network.
    """
    rng = np.random.default_rng(seed)
    _check_refusals(kernel)
    other_shapes = largest is LARGEST
    drawn = (
        random_spec(rng) if number % 2 or not other_shapes else random_shape(rng)
        for number in range(networks)
    )
    for number, spec in enumerate([SMALLEST, largest, *drawn]):
        image = make_image(str(rng.choice(IMAGES)), spec, rng)
        kinds = [str(rng.choice(SIGNS)) for _ in spec.layers]
        blob = with_signs(WeightBlob.random(spec, rng), kinds)
        if rng.integers(2):
            blob = with_edge_thresholds(blob, rng)
        if number % 3:
            blob = with_ties(blob, image, int(rng.integers(len(spec.layers) - 1)), rng)
        assert_exact(kernel, blob, image)
    _check_manners(kernel, rng)


def random_shape(rng: np.random.Generator) -> NetworkSpec:
    """A network with convolutions and an image of its own; small, so that golden is quick."""
    size = image_px = int(rng.integers(8, 57))
    convolutions = []
    for _ in range(rng.integers(1, 5)):
        kernel = int(rng.integers(1, min(size, MAX_KERNEL) + 1))
        stride = int(rng.integers(max(1, kernel // 4), kernel + 1))
        convolutions.append(Convolution(kernel, stride, int(rng.integers(1, 25))))
        size = (size - kernel) // stride + 1
    dims = tuple(int(n) for n in rng.integers(2, 9, rng.integers(1, 5)))
    return NetworkSpec(
        int(rng.integers(1, 9)), int(rng.integers(1, 101)), sum(dims),
        convolutions=tuple(convolutions), image_px=image_px, action_dims=dims,
    )  # fmt: skip


def random_spec(rng: np.random.Generator) -> NetworkSpec:
    """The paper's shape, with free sizes that policies may have."""
    return NetworkSpec(
        int(rng.choice([1, 2, 3, 6])), int(rng.integers(1, 257)), int(rng.integers(2, 65))
    )


def make_image(kind: str, spec: NetworkSpec, rng: np.random.Generator) -> Observation:
    """An observation, uint8[C, rows, columns]: one of `IMAGES`."""
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
    blob: WeightBlob, image: Observation, layer: int, rng: np.random.Generator
) -> WeightBlob:
    """Puts each threshold of a layer at an o that occurs in its channel, or one beside it."""
    o = golden.forward(blob, image)[layer]
    by_channel = o.reshape(-1, o.shape[-1])
    occurring = by_channel[rng.integers(len(by_channel)), :]
    thresholds = list(blob.thresholds)
    thresholds[layer] = (occurring + rng.integers(-1, 2, occurring.shape)).astype(np.int32)
    return replace(blob, thresholds=tuple(thresholds))


def with_signs(blob: WeightBlob, kinds: list[str]) -> WeightBlob:
    """Gives each layer signs of a kind: one of `SIGNS`."""
    constants = {"all +1": 1, "all -1": -1}
    weights = (
        np.full_like(w, constants[kind]) if kind in constants else w
        for kind, w in zip(kinds, blob.weights, strict=True)
    )
    return replace(blob, weights=tuple(weights))


def assert_exact(kernel: Kernel, blob: WeightBlob, image: Observation) -> None:
    """Loads a policy, reads it back, and compares outputs, and activations if it traces, with golden's.

    Raises:
        AssertionError: something differs.
    """
    who = f"kernel {kernel.name!r}, {blob.spec}"
    *inner, expected = golden.forward(blob, image)
    kernel.load(blob)
    held = kernel.read_back()
    for name, parameter in blob.parameters().items():
        assert name in held, f"{who}: read_back() lacks {name}"
        np.testing.assert_array_equal(held[name], parameter, f"{who}: read_back(), {name}")
    trace: Callable[[Observation], tuple[Any, Any]] | None = getattr(kernel, "trace", None)
    if trace is not None:
        activations, traced = trace(image)
        for layer, o, tau, bits in zip(
            blob.spec.layers, inner, blob.thresholds, activations, strict=False
        ):
            expected_bits = (o >= tau).reshape(-1)
            np.testing.assert_array_equal(bits, expected_bits, f"{who}: trace(), {layer.name}")
        np.testing.assert_array_equal(traced, expected, f"{who}: trace(), outputs")
    outputs = kernel.run(image)
    assert outputs.dtype == np.int32, f"{who}: run() gives {outputs.dtype}, not int32"
    np.testing.assert_array_equal(outputs, expected, f"{who}: run()")


def _check_refusals(kernel: Kernel) -> None:
    who, image = f"kernel {kernel.name!r}", make_image("zeros", SMALLEST, np.random.default_rng(0))
    for name, call in (
        ("run", lambda: kernel.run(image)),
        ("read_back", kernel.read_back),
        ("checksum", kernel.checksum),
    ):
        _assert_raises(RuntimeError, f"{who} without weights: {name}()", call)


def _check_manners(kernel: Kernel, rng: np.random.Generator) -> None:
    """What is about more than one call."""
    who, spec = f"kernel {kernel.name!r}", NetworkSpec(3, 20, 5)
    one, other = WeightBlob.random(spec, rng), WeightBlob.random(spec, rng)
    image, second = make_image("random", spec, rng), make_image("random", spec, rng)
    sums = []
    for blob in (one, other, one):
        kernel.load(blob)
        sums.append(kernel.checksum())
    assert sums[0] == sums[2] == kernel.checksum(), (
        f"{who}: checksum() differs for the same weights"
    )
    assert sums[0] != sums[1], f"{who}: checksum() is the same for other weights"
    outputs = kernel.run(image)
    kernel.run(second)
    expected = golden.forward(one, image)[-1]
    np.testing.assert_array_equal(outputs, expected, f"{who}: the next run() overwrites outputs")
    view = np.asfortranarray(image)
    np.testing.assert_array_equal(kernel.run(view), expected, f"{who}: a view that has gaps")
    wrongs: tuple[Any, ...] = (
        image.astype(np.float32), image[:2], image[:, :83], image[np.newaxis],
    )  # fmt: skip
    for wrong in wrongs:
        what = f"{who}: run() of {wrong.dtype}{list(wrong.shape)}"
        _assert_raises(ValueError, what, partial(kernel.run, wrong))


def _assert_raises(kind: type[Exception], what: str, call: Callable[[], object]) -> None:
    try:
        call()
    except kind:
        return
    raise AssertionError(f"{what} does not raise {kind.__name__}")
