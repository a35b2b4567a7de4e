"""edge -> robot: the action for one frame."""

import struct
from typing import NamedTuple

from bpn_shared.messages.base import MessageError, OtherVersionError

SCHEMA = 1
_ACTION = struct.Struct("<BBxxIIQII")
BYTES = _ACTION.size


class Action(NamedTuple):
    """The policy's answer to the frame (reset_id, step).

    Attributes:
        weights_version: of the policy that chose it.
        inference_ns: time in the kernel, at most `LONGEST_NS`.
        edge_ns: from the frame's arrival at the edge to the sending of this action, likewise.
    """

    action: int
    step: int
    weights_version: int
    reset_id: int
    inference_ns: int
    edge_ns: int

    def encode(self) -> bytes:
        """The action as bytes."""
        return _ACTION.pack(
            SCHEMA, self.action, self.step, self.weights_version, self.reset_id, self.inference_ns, self.edge_ns
        )  # fmt: skip

    @classmethod
    def decode(cls, data: bytes, actions: int) -> "Action":
        """Reads `encode`'s bytes.

        Args:
            data: the bytes.
            actions: |A| of the task.

        Raises:
            MessageError: another size or schema, or an action outside 0..|A|-1.
        """
        if len(data) != _ACTION.size:
            raise MessageError(f"action: {len(data)} bytes, expected {_ACTION.size}")
        schema, action, step, version, reset_id, inference_ns, edge_ns = _ACTION.unpack(data)
        if schema != SCHEMA:
            raise OtherVersionError(f"action: schema {schema}, this program reads {SCHEMA}")
        if action >= actions:
            raise MessageError(f"action: {action} is outside 0..{actions - 1}")
        return cls(action, step, version, reset_id, inference_ns, edge_ns)
