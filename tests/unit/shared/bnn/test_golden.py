"""The reference of all kernels against its definition, sum by sum."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.spec.network import Convolution, NetworkSpec

SPEC = NetworkSpec(channels=2, hidden_units=5, actions=3)
PAPER = ((8, 4, 20), (4, 2, 9), (3, 1, 7), (7, 1, 1), (1, 1, 1))
"""Kernel, stride and size of the output of each layer."""
OTHER_SPEC = NetworkSpec(
    channels=3,
    hidden_units=9,
    actions=5,
    convolutions=(Convolution(5, 2, 7), Convolution(3, 3, 10)),
    image_px=30,
    action_dims=(2, 3),
)
OTHER = ((5, 2, 13), (3, 3, 4), (4, 1, 1), (1, 1, 1))


@pytest.mark.parametrize(("spec", "kernels"), [(SPEC, PAPER), (OTHER_SPEC, OTHER)])
@given(seed=st.integers(0, 2**32), data=st.data())
def test_every_output_is_a_patch_times_a_row_of_signs(
    spec: NetworkSpec, kernels: tuple[tuple[int, int, int], ...], seed: int, data: st.DataObject
) -> None:
    rng = np.random.default_rng(seed)
    blob = WeightBlob.random(spec, rng)
    image = rng.integers(0, 256, spec.observation_shape, dtype=np.uint8)
    x = image.transpose(1, 2, 0).astype(int)
    outputs = golden.forward(blob, image)
    for layer, (kernel, stride, size) in enumerate(kernels):
        o = outputs[layer].reshape(size, size, -1)
        row, column = (data.draw(st.integers(0, size - 1)) for _ in range(2))
        out = data.draw(st.integers(0, o.shape[2] - 1))
        signs = iter(blob.weights[layer][out].tolist())
        total = 0
        for i in range(kernel):
            for j in range(kernel):
                for value in x[row * stride + i, column * stride + j].tolist():
                    total += next(signs) * value
        assert o[row, column, out] == total
        assert next(signs, None) is None
        if layer < len(kernels) - 1:
            x = np.array([[[1 if v >= t else -1 for v, t in zip(p, blob.thresholds[layer], strict=True)]
                           for p in line] for line in o])  # fmt: skip
    assert len(outputs) == len(kernels)
    assert {o.dtype for o in outputs} == {np.dtype(np.int32)}


def test_outputs_have_the_layers_shapes() -> None:
    outputs = golden.forward(WeightBlob.random(SPEC, np.random.default_rng(0)), SPEC.probe())
    assert [o.shape for o in outputs] == [(20, 20, 8), (9, 9, 16), (7, 7, 16), (5,), (3,)]


@pytest.mark.parametrize(
    ("channels", "dtype"), [(2, np.int32), (2, np.float32), (2, bool), (1, np.uint8), (3, np.uint8)]
)
def test_another_observation_is_refused_by_name(channels: int, dtype: type) -> None:
    blob = WeightBlob.random(SPEC, np.random.default_rng(0))
    name = np.dtype(dtype).name
    with pytest.raises(
        ValueError, match=rf"observation is {name}\[{channels}, 84, 84\].*uint8\[2, "
    ):
        golden.forward(blob, np.zeros((channels, 84, 84), dtype))


def test_zero_reaches_a_threshold_of_zero() -> None:
    """x = +1 iff o >= tau: a sum that equals its threshold is above it."""
    blob = WeightBlob.random(SPEC, np.random.default_rng(0))
    level = replace(blob, thresholds=tuple(np.zeros_like(tau) for tau in blob.thresholds))
    black = np.zeros(SPEC.observation_shape, np.uint8)
    expected = blob.weights[1].sum(axis=1, dtype=int)  # conv1 gives 0 everywhere, so all +1
    np.testing.assert_array_equal(golden.forward(level, black)[1][0, 0], expected)
