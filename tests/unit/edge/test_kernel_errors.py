import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from bpn_edge import kernel as kernels
from bpn_edge.kernel import _native
from bpn_edge.kernel.native import NativeKernel
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.plugins import PluginError
from bpn_shared.spec.network import NetworkSpec

SPEC = NetworkSpec(3, 20, 5)
BLOB = WeightBlob.random(SPEC, np.random.default_rng(0))
IMAGE = np.random.default_rng(1).integers(0, 256, SPEC.observation_shape, dtype=np.uint8)


@pytest.fixture(params=["native", "golden"])
def kernel(request: pytest.FixtureRequest) -> kernels.Kernel:
    return kernels.load(request.param)


def test_a_kernel_has_its_name(kernel: kernels.Kernel) -> None:
    assert kernels.load(kernel.name).name == kernel.name


def test_an_unknown_kernel_is_refused_with_the_choices() -> None:
    with pytest.raises(
        PluginError, match=r"'gpu' is not installed here; there are: .*golden.*native"
    ):
        kernels.load("gpu")


def test_an_unknown_path_is_refused_with_the_choices() -> None:
    with pytest.raises(ValueError, match=r"'mmx' does not run here; one of: .*portable"):
        NativeKernel("mmx")


def test_running_without_weights_is_refused(kernel: kernels.Kernel) -> None:
    with pytest.raises(RuntimeError, match=r"has no weights: call load\(weights\)"):
        kernel.run(IMAGE)


def test_tracing_without_weights_is_refused() -> None:
    with pytest.raises(RuntimeError, match=r"has no weights: call load\(weights\)"):
        NativeKernel().trace(IMAGE)


@pytest.mark.parametrize(
    "wrong",
    [
        IMAGE.astype(np.float32),
        IMAGE.astype(np.int8),
        IMAGE.astype(bool),
        IMAGE[0],
        IMAGE[:2],
        IMAGE[:, :83],
        IMAGE[:, :, :83],
        IMAGE[np.newaxis],
        IMAGE.transpose(1, 2, 0),
        np.zeros((0, 84, 84), np.uint8),
    ],
    ids=lambda wrong: f"{wrong.dtype}{list(wrong.shape)}",
)
def test_another_dtype_or_shape_is_refused(kernel: kernels.Kernel, wrong: npt.NDArray[Any]) -> None:
    kernel.load(BLOB)
    with pytest.raises(ValueError, match=r"observation is .*takes uint8\[3, 84, 84\]"):
        kernel.run(wrong)


@pytest.mark.parametrize(
    "view",
    [
        lambda x: x[::-1],
        lambda x: x[:, ::-1],
        lambda x: x[:, :, ::-1],
        lambda x: x.transpose(0, 2, 1),
        lambda x: np.repeat(x, 2, axis=0)[::2],
        lambda x: np.repeat(x, 2, axis=2)[:, :, ::2],
        lambda x: np.broadcast_to(x[:1], x.shape),
        np.asfortranarray,
        lambda x: np.frombuffer(b"\0" + x.tobytes(), np.uint8)[1:].reshape(x.shape),
    ],
)
def test_any_view_of_the_right_shape_is_taken(
    kernel: kernels.Kernel, view: Callable[[Any], npt.NDArray[np.uint8]]
) -> None:
    kernel.load(BLOB)
    expected = golden.forward(BLOB, np.ascontiguousarray(view(IMAGE)))[-1]
    np.testing.assert_array_equal(kernel.run(view(IMAGE)), expected)


def test_an_output_is_not_overwritten_by_the_next(kernel: kernels.Kernel) -> None:
    kernel.load(BLOB)
    first = kernel.run(IMAGE)
    kernel.run(255 - IMAGE)
    np.testing.assert_array_equal(first, golden.forward(BLOB, IMAGE)[-1])


def test_weights_of_another_geometry_replace_the_old(kernel: kernels.Kernel) -> None:
    kernel.load(BLOB)
    other = WeightBlob.random(NetworkSpec(1, 300, 64), np.random.default_rng(2))
    kernel.load(other)
    np.testing.assert_array_equal(kernel.run(IMAGE[:1]), golden.forward(other, IMAGE[:1])[-1])


def test_matrices_that_fit_no_network_are_refused() -> None:
    layers = [
        (layer.in_size, layer.in_channels, layer.kernel, layer.stride, layer.out_channels)
        for layer in SPEC.layers
    ]
    _native.Network("portable", False, layers, BLOB.weights, BLOB.thresholds)
    short = (BLOB.thresholds[0][:7], *BLOB.thresholds[1:])
    fewer = [(84, 4, *layers[0][2:]), *layers[1:]]
    for wrong in (
        (fewer, BLOB.weights, BLOB.thresholds),
        (layers, BLOB.weights, short),
        (layers, BLOB.weights[:-1], BLOB.thresholds),
        (layers, BLOB.weights, BLOB.thresholds[:-1]),
        ([], [], []),
        *(
            ([*layers[:k], changed, *layers[k + 1 :]], BLOB.weights, BLOB.thresholds)
            for k in range(5)
            for at in range(5)
            for value in (-1, 0, 17, 1025, 2**31 - 1)
            for changed in [(*layers[k][:at], value, *layers[k][at + 1 :])]
            # a kernel that covers its input has but one place, whatever its stride
            if not (at == 3 and k >= 3 and value > 0)
        ),
    ):
        with pytest.raises(ValueError, match="shapes of no network"):
            _native.Network("portable", False, *wrong)


def test_threads_that_run_while_weights_change_see_one_version_or_the_other() -> None:
    blobs = [WeightBlob.random(SPEC, np.random.default_rng(seed)) for seed in (3, 4)]
    allowed = {golden.forward(blob, IMAGE)[-1].tobytes() for blob in blobs}
    kernel = NativeKernel()
    kernel.load(blobs[0])
    seen: set[bytes] = set()

    def work() -> None:
        seen.update(kernel.run(IMAGE).tobytes() for _ in range(5000))

    threads = [threading.Thread(target=work) for _ in range(3)]
    for thread in threads:
        thread.start()
    for count in range(300):
        kernel.load(blobs[count % 2])
    for thread in threads:
        thread.join()
    assert seen <= allowed
