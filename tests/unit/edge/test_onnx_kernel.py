"""Float policies at the edge; what they should compute is said by ONNX's reference evaluator."""

import contextlib
import io
import sys
from dataclasses import replace

import numpy as np
import onnx
import pytest
from geometries import shapes
from hypothesis import given, settings
from hypothesis import strategies as st
from onnx.reference import ReferenceEvaluator

from bpn_edge.kernel import load
from bpn_edge.kernel.onnx import OnnxKernel
from bpn_edge.kernel.protocol import OutputError
from bpn_edge.memory import WeightMemory, verify
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bnn.envelope import BlobError
from bpn_shared.bnn.float_weights import FloatWeights
from bpn_shared.bnn.onnx_model import onnx_model
from bpn_shared.counters import Counters
from bpn_shared.spec.config import ConfigError
from bpn_shared.spec.network import NetworkSpec

SPEC = NetworkSpec(2, 30, 6)


def random_model(seed: int, spec: NetworkSpec) -> bytes:
    rng = np.random.default_rng(seed)
    weights, biases = [], []
    for layer in spec.layers:
        shape = (layer.out_channels, layer.in_channels, layer.kernel, layer.kernel)
        weights.append((rng.normal(size=shape) / layer.max_input).astype(np.float32))
        biases.append(rng.normal(size=layer.out_channels).astype(np.float32))
    return onnx_model(spec, weights, biases)


def random_policy(seed: int, spec: NetworkSpec = SPEC) -> FloatWeights:
    policy = FloatWeights(spec, random_model(seed, spec), np.zeros(spec.actions, np.float32))
    return replace(policy, probe_outputs=reference(policy, spec.probe()))


def reference(policy: FloatWeights, observation: np.ndarray) -> np.ndarray:
    evaluator = ReferenceEvaluator(onnx.load(io.BytesIO(policy.model)))
    outputs: np.ndarray = evaluator.run(None, {"pixels": observation[None].astype(np.float32)})[0][
        0
    ]
    return outputs


POLICIES = [replace(random_policy(seed), attempt=1, version=seed) for seed in range(3)]
IMAGE = np.random.default_rng(9).integers(0, 256, SPEC.observation_shape, dtype=np.uint8)


@pytest.mark.parametrize("seed", range(3))
def test_the_kernel_computes_what_the_model_says(seed: int) -> None:
    kernel = load("onnx")
    kernel.load(POLICIES[seed])
    outputs = kernel.run(IMAGE)
    assert outputs.dtype == np.float32
    expected = reference(POLICIES[seed], IMAGE)
    np.testing.assert_allclose(outputs, expected, rtol=1e-4, atol=1e-4 * np.abs(expected).max())
    verify(kernel, POLICIES[seed])


@given(shapes(), st.integers(0, 2**32))
@settings(max_examples=20)
def test_networks_of_any_shape_run(spec: NetworkSpec, seed: int) -> None:
    policy, kernel = random_policy(seed, spec), load("onnx")
    kernel.load(FloatWeights.decode(policy.encode()))
    verify(kernel, policy)


def test_banks_are_swapped_between_two_frames() -> None:
    memory = WeightMemory("onnx", Counters())
    for version in range(3):
        before = memory.run(IMAGE) if version else None
        memory.offer(POLICIES[version])
        if before is not None:
            np.testing.assert_array_equal(memory.run(IMAGE), before)
        assert memory.activate(version, timeout_s=0)
        expected = reference(POLICIES[version], IMAGE)
        np.testing.assert_allclose(memory.run(IMAGE), expected, rtol=1e-3, atol=1e-2)


def refused(policy: FloatWeights) -> dict[str, int]:
    counters = Counters()
    memory = WeightMemory("onnx", counters)
    memory.offer(POLICIES[0])
    memory.activate(0, timeout_s=0)
    running = memory.run(IMAGE)
    memory.offer(replace(policy, version=7))
    assert not memory.activate(7, timeout_s=0)
    np.testing.assert_array_equal(memory.run(IMAGE), running)
    return counters.snapshot()


def test_a_model_that_computes_something_else_is_not_used() -> None:
    swapped = replace(POLICIES[1], model=POLICIES[2].model)
    assert refused(swapped) == {"weights_failed_verification": 1}
    off_by_little = POLICIES[1].probe_outputs * np.float32(1.01)
    assert refused(replace(POLICIES[1], probe_outputs=off_by_little)) == {
        "weights_failed_verification": 1
    }


@pytest.mark.parametrize(("share", "passes"), [(9e-4, True), (-9e-4, True), (2e-3, False)])
def test_a_kernel_may_round_by_a_thousandth_of_the_largest_and_no_more(
    share: float, passes: bool
) -> None:
    policy, kernel = POLICIES[1], OnnxKernel()
    kernel.load(policy)
    expected = policy.probe_outputs
    rounded = expected + np.float32(share * np.abs(expected).max())
    with contextlib.nullcontext() if passes else pytest.raises(BlobError, match="another P"):
        verify(kernel, replace(policy, probe_outputs=rounded))


@given(st.binary(min_size=1, max_size=500))
def test_noise_for_a_model_is_refused(noise: bytes) -> None:
    with pytest.raises(BlobError, match="the model"):
        OnnxKernel().load(replace(POLICIES[0], model=noise))


@given(st.integers(0, 2**31), st.integers(0, 7))
def test_a_damaged_model_does_no_more_than_raise_blob_error(position: int, bit: int) -> None:
    damaged = bytearray(POLICIES[0].model)
    damaged[position % len(damaged)] ^= 1 << bit
    kernel = OnnxKernel()
    try:
        kernel.load(replace(POLICIES[0], model=bytes(damaged)))
        verify(kernel, POLICIES[0])
    except BlobError:
        return
    assert bytes(damaged) == POLICIES[0].model  # whatever the outputs, the parameters are compared


def test_a_model_of_another_geometry_is_refused() -> None:
    other = random_policy(0, NetworkSpec(2, 30, 7))
    assert refused(replace(POLICIES[0], model=other.model)) == {"weights_failed_verification": 1}
    with pytest.raises(BlobError, match=r"float32\[6, 30\] has 720"):
        OnnxKernel().load(replace(POLICIES[0], model=other.model))


def test_kernels_refuse_the_other_kind_of_policy() -> None:
    blob = WeightBlob.random(SPEC, np.random.default_rng(0))
    with pytest.raises(BlobError, match="the onnx kernel runs float policies"):
        OnnxKernel().load(blob)
    for name in ("native", "golden"):
        with pytest.raises(BlobError, match=f"the {name} kernel runs binarized policies"):
            load(name).load(POLICIES[0])


def test_a_kernel_without_weights_and_wrong_images_are_refused() -> None:
    kernel = OnnxKernel()
    with pytest.raises(RuntimeError, match="has no weights"):
        kernel.run(IMAGE)
    kernel.load(POLICIES[0])
    with pytest.raises(ValueError, match="the network"):
        kernel.run(IMAGE[:1])


def test_without_onnxruntime_the_error_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    monkeypatch.delitem(sys.modules, "bpn_edge.kernel.onnx")
    with pytest.raises(ConfigError, match=r"pip install 'bpn-edge\[float\]'"):
        load("onnx")


def test_outputs_that_are_no_numbers_are_named_and_not_played() -> None:
    model = onnx.load_from_string(POLICIES[0].model)  # finite parameters whose sums are not
    for tensor in model.graph.initializer:
        if tensor.name in ("weights3", "biases3"):
            values = onnx.numpy_helper.to_array(tensor)
            tensor.raw_data = np.full(values.shape, 3e38, np.float32).tobytes()
    broken = replace(POLICIES[0], model=model.SerializeToString())
    kernel = OnnxKernel()
    kernel.load(broken)
    with pytest.raises(OutputError, match="of the 6 outputs are not finite: no action can be"):
        kernel.run(IMAGE)
    assert refused(broken) == {"weights_failed_verification": 1}
