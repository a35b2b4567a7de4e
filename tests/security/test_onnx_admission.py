"""Float policies that do harm: files read, loops, memory, values that no policy has. None is ever loaded."""

import resource
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from geometries import geometries
from hypothesis import given
from hypothesis import strategies as st
from onnx import ModelProto, TensorProto, helper, numpy_helper

from bpn_edge.kernel.onnx import OnnxKernel
from bpn_edge.kernel.onnx_admission import admit
from bpn_edge.memory import WeightMemory
from bpn_learner.networks import make_network
from bpn_shared.bnn.envelope import BlobError
from bpn_shared.bnn.float_weights import FloatWeights
from bpn_shared.counters import Counters
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.network import NetworkSpec

SPEC = NetworkSpec(1, 8, 4)


def exported(spec: NetworkSpec = SPEC, seed: int = 0) -> FloatWeights:
    """What a learner exports."""
    network = make_network(
        "float", spec, scale_initial=1.0, generator=torch.Generator().manual_seed(seed)
    )
    weights = network.export()
    assert isinstance(weights, FloatWeights)
    return weights


GOOD = exported()


@given(
    spec=geometries(range(1, 7), 64, 40),
    seed=st.integers(0, 2**31),
)  # fmt: skip
def test_every_export_of_a_learner_is_admitted(spec: NetworkSpec, seed: int) -> None:
    admit(exported(spec, seed).model, spec)


@pytest.mark.parametrize("algorithm", ["cvi", "dqn", "dpp"])
def test_the_policies_of_each_float_algorithm_run(algorithm: str) -> None:
    config = RunConfig.for_task("reaching", algorithm=algorithm, kernel="onnx")
    memory = WeightMemory("onnx", Counters())
    assert memory.offer(exported(config.network))
    assert memory.activate(0, timeout_s=0)


def changed(change: Callable[[ModelProto], object]) -> bytes:
    model = onnx.load_from_string(GOOD.model)
    change(model)
    data: bytes = model.SerializeToString(deterministic=True)
    return data


def constant(name: str, values: np.ndarray) -> TensorProto:
    return numpy_helper.from_array(values, name)


def alone(nodes: list, constants: list, value: str) -> bytes:
    """A small model of the right inputs and outputs that computes something else."""
    graph = helper.make_graph(
        nodes, "policy",
        [helper.make_tensor_value_info("pixels", TensorProto.FLOAT, [1, *SPEC.observation_shape])],
        [helper.make_tensor_value_info(value, TensorProto.FLOAT, [1, SPEC.actions])], constants,
    )  # fmt: skip
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)])
    model.ir_version = 10
    data: bytes = model.SerializeToString()
    return data


def external(location: str) -> bytes:
    def change(model: ModelProto) -> None:
        tensor = model.graph.initializer[1]
        size = len(tensor.raw_data)
        tensor.ClearField("raw_data")
        tensor.data_location = TensorProto.EXTERNAL
        for key, value in (("location", location), ("offset", "0"), ("length", str(size))):
            tensor.external_data.add(key=key, value=value)

    return changed(change)


def stolen_file() -> bytes:
    """P is what stands in a file: it would be read out of a refusal's line."""
    data = TensorProto(name="secret", data_type=TensorProto.UINT8, dims=[SPEC.actions])
    data.data_location = TensorProto.EXTERNAL
    for key, value in (("location", "secret.pem"), ("length", str(SPEC.actions))):
        data.external_data.add(key=key, value=value)
    nodes = [
        helper.make_node("Cast", ["secret"], ["numbers"], to=TensorProto.FLOAT),
        helper.make_node("Unsqueeze", ["numbers", "axis"], ["P"]),
    ]
    return alone(nodes, [data, constant("axis", np.array([0], np.int64))], "P")


def endless_loop() -> bytes:
    body = helper.make_graph(
        [helper.make_node("Identity", ["condition"], ["again"]),
         helper.make_node("Identity", ["before"], ["after"])],
        "body",
        [helper.make_tensor_value_info("index", TensorProto.INT64, []),
         helper.make_tensor_value_info("condition", TensorProto.BOOL, []),
         helper.make_tensor_value_info("before", TensorProto.FLOAT, [1, SPEC.actions])],
        [helper.make_tensor_value_info("again", TensorProto.BOOL, []),
         helper.make_tensor_value_info("after", TensorProto.FLOAT, [1, SPEC.actions])],
    )  # fmt: skip
    nodes = [helper.make_node("Loop", ["times", "yes", "start"], ["P"], body=body)]
    constants = [
        constant("times", np.array(2**62)), constant("yes", np.array(True)),
        constant("start", np.zeros((1, SPEC.actions), np.float32)),
    ]  # fmt: skip
    return alone(nodes, constants, "P")


def much_memory(operator: str) -> bytes:
    shape = constant("shape", np.array([1, 10**9], np.int64))
    if operator == "Expand":
        nodes = [helper.make_node("Expand", ["one", "shape"], ["all"])]
        constants = [shape, constant("one", np.zeros((1, 1), np.float32))]
    else:
        nodes = [helper.make_node("ConstantOfShape", ["shape"], ["all"])]
        constants = [shape]
    nodes.append(helper.make_node("Slice", ["all", "begin", "end", "axis"], ["P"]))
    for name, value in (("begin", 0), ("end", SPEC.actions), ("axis", 1)):
        constants.append(constant(name, np.array([value], np.int64)))
    return alone(nodes, constants, "P")


def with_weight(value: float) -> bytes:
    def change(model: ModelProto) -> None:
        tensor = model.graph.initializer[2]
        values = numpy_helper.to_array(tensor).copy()
        values.flat[-1] = value
        tensor.raw_data = values.tobytes()

    return changed(change)


def with_unknown_field() -> bytes:
    return GOOD.model + bytes.fromhex("fa3f05") + b"later"  # field 1023 of a message that has none


ATTACKS: dict[str, bytes] = {
    "a file beside": external("secret.pem"),
    "a file above": external("../secret.pem"),
    "a file anywhere": external("/etc/hostname"),
    "a file as P": stolen_file(),
    "a loop": endless_loop(),
    "Expand": much_memory("Expand"),
    "ConstantOfShape": much_memory("ConstantOfShape"),
    "NaN": with_weight(np.nan),
    "infinity": with_weight(np.inf),
    "another operator": changed(lambda m: setattr(m.graph.node[1], "op_type", "Sigmoid")),
    "another domain": changed(lambda m: setattr(m.graph.node[1], "domain", "com.microsoft")),
    "another stride": changed(lambda m: m.graph.node[0].attribute[0].ints.__setitem__(0, 1)),
    "one more attribute": changed(lambda m: m.graph.node[0].attribute.append(
        helper.make_attribute("pads", [1, 1, 1, 1]))),
    "one more node": changed(lambda m: m.graph.node.append(
        helper.make_node("Relu", [m.graph.output[0].name], ["more"]))),
    "one more weight": changed(lambda m: m.graph.initializer.append(
        constant("more", np.zeros(2, np.float32)))),
    "a weight twice": changed(lambda m: m.graph.initializer.append(m.graph.initializer[0])),
    "a weight of another type": changed(
        lambda m: setattr(m.graph.initializer[0], "data_type", TensorProto.INT32)),
    "a weight of another shape": changed(lambda m: m.graph.initializer[0].dims.reverse()),
    "numbers beside the raw data": changed(lambda m: m.graph.initializer[0].float_data.append(1.0)),
    "a function": changed(lambda m: m.functions.append(helper.make_function(
        "own", "Relu", ["x"], ["y"], [helper.make_node("Neg", ["x"], ["y"])],
        [helper.make_opsetid("", 17)]))),
    "metadata": changed(lambda m: m.metadata_props.add(key="session.load_config", value="1")),
    "a note": changed(lambda m: setattr(m, "doc_string", "hello")),
    "another opset": changed(lambda m: setattr(m.opset_import[0], "version", 18)),
    "another IR": changed(lambda m: setattr(m, "ir_version", 9)),
    "an unknown field": with_unknown_field(),
    "a sparse weight": changed(lambda m: m.graph.sparse_initializer.add()),
    "training": changed(lambda m: m.training_info.add()),
    "another geometry": exported(NetworkSpec(1, 9, 4)).model,
    "nothing": b"\x00",
}  # fmt: skip


@pytest.mark.timeout(30)
@pytest.mark.parametrize("attack", ATTACKS)
def test_no_other_model_is_loaded(
    attack: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """The bank that runs goes on, time and memory stay small, and nothing is told of files or values."""
    (tmp_path / "secret.pem").write_bytes(b"\x99\x88\x77\x66" * 10_000)
    monkeypatch.chdir(tmp_path)
    counters = Counters()
    memory = WeightMemory("onnx", counters)
    assert memory.offer(GOOD)
    assert memory.activate(0, timeout_s=0)
    image = SPEC.probe()
    before = memory.run(image)
    peak_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    monkeypatch.setattr(onnxruntime, "InferenceSession", None)  # it is not even asked
    model = ATTACKS[attack]
    assert not memory.offer(replace(GOOD, model=model, version=1))
    assert counters.snapshot() == {"weights_failed_verification": 1}
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak_kib < 64 * 1024
    np.testing.assert_array_equal(memory.run(image), before)
    assert "the model" in caplog.text
    for told in ("153", "136", "0x99", "secret", "hello"):
        assert told not in caplog.text
    with pytest.raises(BlobError):
        OnnxKernel().load(replace(GOOD, model=model))


def test_a_policy_whose_answer_is_wrong_tells_no_value(caplog: pytest.LogCaptureFixture) -> None:
    memory = WeightMemory("onnx", Counters())
    wrong = GOOD.probe_outputs + np.float32(12345)
    assert not memory.offer(replace(GOOD, probe_outputs=wrong))
    assert "12345" not in caplog.text
    assert "than the learner" in caplog.text


@given(st.data())
def test_any_changed_byte_that_is_no_weights_is_refused(data: st.DataObject) -> None:
    model = bytearray(GOOD.model)
    position = data.draw(st.integers(0, len(model) - 1))
    model[position] ^= data.draw(st.integers(1, 255))
    try:
        admit(bytes(model), SPEC)
    except BlobError:
        return
    kept, found = (onnx.load_from_string(bytes(m)) for m in (GOOD.model, model))
    for each in (kept, found):
        for tensor in each.graph.initializer:
            tensor.ClearField("raw_data")
    assert kept == found
