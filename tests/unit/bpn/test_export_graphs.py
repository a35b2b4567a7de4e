"""ONNX and QONNX exports against the golden model, on every layer, by runtimes that nobody here wrote."""

import io
from typing import Any
from unittest.mock import patch

import numpy as np
import onnx
import onnxruntime
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from networks import SPECS, awkward_blob, awkward_observation
from qonnx.core.modelwrapper import ModelWrapper
from qonnx.core.onnx_exec import execute_onnx

from bpn.export.onnx_graph import INPUT, OUTPUT, encode, onnx_model, qonnx_model, sums_name
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.spec.network import NetworkSpec


def by_onnx_runtime(blob: WeightBlob, pixels: np.ndarray) -> dict[str, np.ndarray]:
    """All layers' sums, and P."""
    model = onnx.load(io.BytesIO(encode(onnx_model(blob))))
    names = [sums_name(layer) for layer in blob.spec.layers]
    for name in names:
        model.graph.output.append(onnx.helper.make_empty_tensor_value_info(name))
    session = onnxruntime.InferenceSession(
        model.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    return dict(zip([*names, OUTPUT], session.run([*names, OUTPUT], {INPUT: pixels}), strict=True))


def by_qonnx(blob: WeightBlob, pixels: np.ndarray) -> dict[str, np.ndarray]:
    model = ModelWrapper(encode(qonnx_model(blob)))
    # Its executor makes a model of every node, in onnx's newest form, which ONNX Runtime reads only months later.
    with patch.object(onnx, "IR_VERSION", model.model.ir_version):
        found: dict[str, np.ndarray] = execute_onnx(
            model, {INPUT: pixels}, return_full_exec_context=True
        )
    return found


@pytest.mark.parametrize("run", [by_onnx_runtime, by_qonnx])
@settings(max_examples=12)
@given(spec=SPECS, seed=st.integers(0, 2**32 - 1))
def test_every_layer_is_exact(run: Any, spec: NetworkSpec, seed: int) -> None:
    rng = np.random.default_rng(seed)
    blob, observation = awkward_blob(spec, rng), awkward_observation(spec, rng)
    found = run(blob, observation[np.newaxis].astype(np.float32))
    expected = golden.forward(blob, observation)
    for layer, o in zip(spec.layers, expected, strict=True):
        # [1, channels, rows, columns], the golden model's channels are last
        sums = found[sums_name(layer)][0].transpose(1, 2, 0)
        np.testing.assert_array_equal(sums.reshape(o.shape), o)
    np.testing.assert_allclose(found[OUTPUT][0], expected[-1] * np.float32(blob.scale), rtol=1e-6)


@pytest.mark.parametrize("make", [onnx_model, qonnx_model])
def test_equal_policies_give_equal_bytes(make: Any) -> None:
    blob = awkward_blob(NetworkSpec(1, 5, 3), np.random.default_rng(3))
    assert encode(make(blob)) == encode(make(blob))
    onnx.checker.check_model(make(blob))
