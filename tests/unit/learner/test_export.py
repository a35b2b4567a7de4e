"""Export of float networks: ONNX's own evaluators say what the exported model computes."""

import io

import numpy as np
import onnx
import pytest
import torch
from geometries import geometries, shapes
from hypothesis import given, settings
from hypothesis import strategies as st
from onnx.reference import ReferenceEvaluator

from bpn_learner.fold import fold
from bpn_learner.networks import BinaryNetwork, FloatNetwork, PNetwork, make_network
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bnn.envelope import BlobError
from bpn_shared.bnn.float_weights import FloatWeights, max_model_bytes
from bpn_shared.spec.network import NetworkSpec

SPEC = NetworkSpec(channels=2, hidden_units=12, actions=5)
specs = geometries(range(1, 9), 64, 20) | shapes()


def float_network(spec: NetworkSpec = SPEC, seed: int = 0) -> FloatNetwork:
    return FloatNetwork(spec, generator=torch.Generator().manual_seed(seed))


def exported(network: FloatNetwork) -> FloatWeights:
    policy = network.export()
    assert isinstance(policy, FloatWeights)
    return policy


@settings(max_examples=15)
@given(specs, st.integers(0, 1000))
def test_the_exported_model_computes_what_the_network_does(spec: NetworkSpec, seed: int) -> None:
    network = float_network(spec, seed).eval()
    policy = exported(network)
    model = onnx.load(io.BytesIO(policy.model))
    onnx.checker.check_model(model, full_check=True)
    image = np.random.default_rng(seed).integers(0, 256, (1, *spec.observation_shape), np.uint8)
    with torch.no_grad():
        expected = network(torch.from_numpy(image).float()).numpy()
    (P,) = ReferenceEvaluator(model).run(None, {"pixels": image.astype(np.float32)})
    np.testing.assert_allclose(P, expected, rtol=1e-4, atol=1e-5)
    (probe,) = ReferenceEvaluator(model).run(
        None, {"pixels": spec.probe()[None].astype(np.float32)}
    )
    np.testing.assert_allclose(policy.probe_outputs, probe[0], rtol=1e-4, atol=1e-5)
    assert 0.9 * max_model_bytes(spec) - 16_384 < len(policy.model) <= max_model_bytes(spec)


def test_equal_networks_give_equal_bytes_and_others_do_not() -> None:
    assert exported(float_network()).encode() == exported(float_network()).encode()
    first, other = exported(float_network()), exported(float_network(seed=1))
    assert first.content_sha256() != other.content_sha256()


def test_each_kind_is_exported_as_its_own_policy() -> None:
    binary = make_network("binary", SPEC, scale_initial=0.3, generator=torch.Generator())
    assert isinstance(binary, BinaryNetwork)
    policy = binary.export(attempt=2, version=3)
    assert isinstance(policy, WeightBlob)
    assert policy.encode() == fold(binary, attempt=2, version=3).encode()
    network = make_network("float", SPEC, scale_initial=0.3, generator=torch.Generator())
    assert isinstance(network, FloatNetwork)
    assert (network.export(attempt=2, version=3).attempt, exported(network).scale) == (2, 1.0)
    with pytest.raises(NotImplementedError):
        PNetwork(SPEC).export()


def test_a_network_that_is_not_finite_is_not_exported() -> None:
    network = float_network()
    network.biases.data[-1] = float("nan")
    with pytest.raises(BlobError, match="not finite"):
        network.export()
