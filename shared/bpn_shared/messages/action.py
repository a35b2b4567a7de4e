"""edge -> robot: the action for one frame."""

import struct
from typing import NamedTuple

from bpn_shared.messages.base import MessageError, OtherVersionError

SCHEMA = 2
_ACTION = struct.Struct("<BxxxIIQQII")
BYTES = _ACTION.size
_OLDER = struct.Struct("<BBxxIIQII")
"""Schema 1: an action was a byte, and stood before the step."""


class Action(NamedTuple):
    """The policy's answer to the frame (reset_id, step).

    Attributes:
        action: its number, of 0..joint_actions-1 of the task.
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
            SCHEMA, self.step, self.weights_version, self.reset_id, self.action, self.inference_ns, self.edge_ns
        )  # fmt: skip

    @classmethod
    def decode(cls, data: bytes, actions: int) -> "Action":
        """Reads `encode`'s bytes, and those of older schemas.

        Args:
            data: the bytes.
            actions: how many the task has.

        Raises:
            OtherVersionError: a schema that this program does not read.
            MessageError: another size, or an action outside 0..actions-1.
        """
        schema = data[0] if data else SCHEMA
        if schema not in (1, SCHEMA):
            raise OtherVersionError(f"action: schema {schema}, this program reads 1 and {SCHEMA}")
        form = _OLDER if schema == 1 else _ACTION
        if len(data) != form.size:
            raise MessageError(f"action: {len(data)} bytes, expected {form.size}")
        if schema == 1:
            _, action, step, version, reset_id, inference_ns, edge_ns = form.unpack(data)
        else:
            _, step, version, reset_id, action, inference_ns, edge_ns = form.unpack(data)
        if action >= actions:
            raise MessageError(f"action: {action} is outside 0..{actions - 1}")
        return cls(action, step, version, reset_id, inference_ns, edge_ns)
