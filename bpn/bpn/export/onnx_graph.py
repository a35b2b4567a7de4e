"""A binarized policy as an ONNX model, and as a QONNX one for toolchains of quantized networks.

Both take `pixels` float32[1, C, rows, columns] of 0..255 and give P float32[1, |A|]. All integers are below 2^24:
float32 holds them, and every order of summation gives the same.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from onnx import TensorProto, helper, numpy_helper

from bpn_shared.bnn.blob import WeightBlob, canonical_thresholds
from bpn_shared.spec.network import Layer

INPUT, OUTPUT = "pixels", "preferences"
_OPSET = 17
_IR_VERSION = 10
_QONNX_DOMAIN = "qonnx.custom_op.general"


def sums_name(layer: Layer) -> str:
    """What a model calls the integers o of a layer."""
    return f"{layer.name}_sums"


def onnx_model(blob: WeightBlob) -> Any:
    """The policy in operators that every ONNX runtime has."""
    graph = _Graph(blob)
    for index, layer in enumerate(blob.spec.layers):
        graph.constant(f"{layer.name}_signs", graph.kernels(index))
        graph.sums(layer, f"{layer.name}_signs")
        if index < len(blob.thresholds):
            active = f"{layer.name}_active"
            tau = graph.thresholds(index).reshape(1, -1, 1, 1)
            graph.constant(f"{layer.name}_thresholds", tau)
            graph.node("GreaterOrEqual", [graph.value, f"{layer.name}_thresholds"], active)
            graph.node("Where", [active, "plus_one", "minus_one"], layer.name)
            graph.shape(layer.name, _map(layer))
    graph.constant("plus_one", np.float32(1))
    graph.constant("minus_one", np.float32(-1))
    return graph.model("ai.onnx")


def qonnx_model(blob: WeightBlob) -> Any:
    """The policy in QONNX: weights by BipolarQuant, activations by MultiThreshold with one threshold each."""
    graph = _Graph(blob)
    graph.constant("one", np.float32(1))
    for index, layer in enumerate(blob.spec.layers):
        raw, signs = f"{layer.name}_weights", f"{layer.name}_signs"
        graph.constant(raw, graph.kernels(index))
        graph.node("BipolarQuant", [raw, "one"], signs, domain=_QONNX_DOMAIN, follow=False)
        graph.shape(signs, graph.kernels(index).shape)
        graph.sums(layer, signs)
        if index < len(blob.thresholds):
            graph.constant(f"{layer.name}_thresholds", graph.thresholds(index).reshape(-1, 1))
            graph.node(
                "MultiThreshold",
                [graph.value, f"{layer.name}_thresholds"],
                layer.name,
                domain=_QONNX_DOMAIN,
                out_dtype="BIPOLAR",
                out_scale=2.0,
                out_bias=-1.0,
            )
            graph.shape(layer.name, _map(layer))
    return graph.model(_QONNX_DOMAIN)


def encode(model: Any) -> bytes:
    """The model's bytes; the same for the same policy."""
    encoded: bytes = model.SerializeToString(deterministic=True)
    return encoded


def _map(layer: Layer) -> tuple[int, int, int, int]:
    return 1, layer.out_channels, layer.out_size, layer.out_size


class _Graph:
    """A model in the making; `value` is what the last node gave."""

    def __init__(self, blob: WeightBlob) -> None:
        self._blob = blob
        self._nodes: list[Any] = []
        self._constants: list[Any] = []
        self._shapes: list[Any] = []
        self.value = INPUT

    def kernels(self, index: int) -> npt.NDArray[np.float32]:
        """A layer's signs, float32[out, in, kernel, kernel]."""
        layer, signs = self._blob.spec.layers[index], self._blob.weights[index]
        shape = layer.out_channels, layer.kernel, layer.kernel, layer.in_channels
        return np.ascontiguousarray(signs.reshape(shape).transpose(0, 3, 1, 2), np.float32)

    def thresholds(self, index: int) -> npt.NDArray[np.float32]:
        """A layer's thresholds, float32[out], within what its sums can be: float32 cannot hold all of int32."""
        layer = self._blob.spec.layers[index]
        return canonical_thresholds(layer, self._blob.thresholds[index]).astype(np.float32)

    def constant(self, name: str, values: npt.ArrayLike) -> None:
        self._constants.append(numpy_helper.from_array(np.asarray(values), name))

    def node(
        self, operator: str, inputs: list[str], output: str, *, follow: bool = True, **options: Any
    ) -> None:
        self._nodes.append(helper.make_node(operator, inputs, [output], name=output, **options))
        if follow:
            self.value = output

    def sums(self, layer: Layer, signs: str) -> None:
        """The layer's o: a convolution, whose kernel covers the whole input where it is fully connected."""
        self.node(
            "Conv",
            [self.value, signs],
            sums_name(layer),
            strides=[layer.stride] * 2,
            kernel_shape=[layer.kernel] * 2,
        )
        self.shape(self.value, _map(layer))

    def shape(self, name: str, shape: Sequence[int]) -> None:
        """Tells a tensor's shape: QONNX's executor does not infer them."""
        self._shapes.append(helper.make_tensor_value_info(name, TensorProto.FLOAT, shape))

    def model(self, domain: str) -> Any:
        spec = self._blob.spec
        self.constant("scale", np.float32(self._blob.scale))
        self.node("Flatten", [self.value], "outputs")
        self.shape("outputs", [1, spec.actions])
        self.node("Mul", ["outputs", "scale"], OUTPUT)
        tensor = helper.make_tensor_value_info
        graph = helper.make_graph(
            self._nodes,
            "policy",
            [tensor(INPUT, TensorProto.FLOAT, [1, *spec.observation_shape])],
            [tensor(OUTPUT, TensorProto.FLOAT, [1, spec.actions])],
            self._constants,
            value_info=self._shapes,
        )
        opsets = [helper.make_opsetid("", _OPSET)]
        if domain == _QONNX_DOMAIN:
            opsets.append(helper.make_opsetid(domain, 1))
        model = helper.make_model(graph, opset_imports=opsets)
        model.ir_version = _IR_VERSION
        return model
