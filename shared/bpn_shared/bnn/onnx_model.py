"""A float network as an ONNX model: the same weights give the same bytes.

Needs `onnx`, which learners have, and edges that run float policies.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from onnx import TensorProto, helper, numpy_helper

from bpn_shared.spec.network import NetworkSpec

Floats = npt.NDArray[np.float32]

INPUT = "pixels"
_OPSET = 17
_IR_VERSION = 10  # runtimes read older models, and refuse those of a newer onnx


def onnx_model(spec: NetworkSpec, weights: Sequence[Floats], biases: Sequence[Floats]) -> bytes:
    """The network with ReLU after all layers but the last, from `pixels` to P.

    `pixels` is float32[1, C, rows, columns], P float32[1, |A|].

    Args:
        spec: geometry.
        weights: per layer float32[out, in, kernel, kernel]; a fully connected one covers its whole input.
        biases: per layer float32[out].
    """
    nodes: list[Any] = []
    constants: list[Any] = []
    value = INPUT

    def append(operator: str, *constant_names: str, **attributes: Any) -> None:
        nonlocal value
        output = f"{operator}{len(nodes)}"
        nodes.append(helper.make_node(operator, [value, *constant_names], [output], **attributes))
        value = output

    for index, layer in enumerate(spec.layers):
        names = f"weights{index}", f"biases{index}"
        kernels = weights[index]
        if index > 0:
            append("Relu")
        if layer.is_fully_connected:
            append("Flatten")
            append("Gemm", *names, transB=1)
        else:
            append("Conv", *names, strides=[layer.stride] * 2)
        kernels = kernels.reshape(constant_shapes(spec)[names[0]])
        constants += map(numpy_helper.from_array, (kernels, biases[index]), names)
    graph = helper.make_graph(
        nodes,
        "policy",
        [_tensor(INPUT, spec.observation_shape)],
        [_tensor(value, (spec.actions,))],
        constants,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", _OPSET)])
    model.ir_version = _IR_VERSION
    encoded: bytes = model.SerializeToString(deterministic=True)
    return encoded


def constant_shapes(spec: NetworkSpec) -> dict[str, tuple[int, ...]]:
    """The shapes of a model's weights and biases, all float32, by name."""
    shapes: dict[str, tuple[int, ...]] = {}
    for index, layer in enumerate(spec.layers):
        kernels = (layer.out_channels, layer.in_channels, layer.kernel, layer.kernel)
        shapes[f"weights{index}"] = layer.weight_shape if layer.is_fully_connected else kernels
        shapes[f"biases{index}"] = (layer.out_channels,)
    return shapes


def _tensor(name: str, shape: tuple[int, ...]) -> Any:
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, *shape])
