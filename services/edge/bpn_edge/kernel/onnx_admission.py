"""Which float policies may be loaded: those that a learner exports, and no other ONNX model.

ONNX is a language: a model of 300 bytes can read files beside it, loop for ever, or ask for all memory, and a
runtime does as it says. So no runtime gets a graph that was received. Its weights are taken out, if they have the
sizes of the geometry and are finite; the model that a learner makes of them is built again; and if that is not
what came, byte for byte, the policy is refused. What is said of a refused one holds no value of its own.
"""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from google.protobuf.message import DecodeError
from onnx import ModelProto, TensorProto

from bpn_shared.bnn.envelope import BlobError
from bpn_shared.bnn.onnx_model import constant_shapes, onnx_model
from bpn_shared.spec.network import NetworkSpec

Floats = npt.NDArray[np.float32]


def admit(model: bytes, spec: NetworkSpec) -> None:
    """Lets a model pass that is a learner's export for this geometry, with finite weights.

    Takes milliseconds, and memory of the order of the model's size, whatever the bytes are.

    Raises:
        BlobError: it is none; the message says in what way.
    """
    try:
        graph = ModelProto.FromString(model).graph
    except DecodeError as error:
        raise BlobError("the model is no ONNX") from error
    shapes = constant_shapes(spec)
    found = {tensor.name: tensor for tensor in graph.initializer}
    if len(graph.initializer) != len(shapes) or found.keys() != shapes.keys():
        raise BlobError(f"the model has other weights than one of geometry {spec}")
    constants = {name: _values(found[name], name, shape) for name, shape in shapes.items()}
    if _exported(spec, constants) != model:
        raise BlobError(
            f"the model is not what a learner exports for geometry {spec}: its graph has other operators, "
            "attributes, types or notes"
        )


def _values(tensor: TensorProto, name: str, shape: tuple[int, ...]) -> Floats:
    """The tensor's values, float32 of that shape.

    Raises:
        BlobError: they are others, lie elsewhere, or are not finite.
    """
    size_bytes = 4 * int(np.prod(shape))
    if len(tensor.raw_data) != size_bytes:  # as of data in another form, or in another file
        raise BlobError(
            f"the model's {name} have {len(tensor.raw_data)} bytes, float32{list(shape)} has {size_bytes}"
        )
    values = np.frombuffer(tensor.raw_data, "<f4").reshape(shape)
    if not np.isfinite(values).all():
        raise BlobError(f"the model's {name} are not finite")
    return values


def _exported(spec: NetworkSpec, constants: Mapping[str, Floats]) -> bytes:
    layers = range(len(spec.layers))
    return onnx_model(
        spec,
        [constants[f"weights{index}"] for index in layers],
        [constants[f"biases{index}"] for index in layers],
    )
