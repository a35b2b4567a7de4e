"""The checkpoint: everything that the next iteration needs and that cannot be derived.

One safetensors file, replaced atomically, with a digest over its arrays. Random numbers need no state
(`bpn_shared.spec.seeds`), and the data sets are the run folder's episodes, on disk since before they were
acknowledged.
"""

import json
import logging
import struct
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor, nn

from bpn_shared.runs.digests import arrays_digest
from bpn_shared.version import VERSION

log = logging.getLogger(__name__)

SCHEMA = 2
"""Schema 1 had no metadata, so no digest."""

_NETWORK, _OPTIMIZER, _ITERATION = "network.", "optimizer.", "iteration"
_MAX_ITERATION = 2**31


class CheckpointError(RuntimeError):
    """The checkpoint cannot be used; the message says why and what to do."""


def encode_checkpoint(
    network: nn.Module, optimizer: torch.optim.Optimizer, iteration: int
) -> bytes:
    """The state after `iteration` policy updates."""
    tensors = state_tensors(network, optimizer) | {_ITERATION: torch.tensor(iteration)}
    return save(tensors, metadata={"schema": str(SCHEMA), "sha256": _digest(tensors)})


def state_tensors(network: nn.Module, optimizer: torch.optim.Optimizer) -> dict[str, Tensor]:
    """Network and optimizer by name, as `restore` takes them."""
    tensors = {f"{_NETWORK}{name}": value for name, value in network.state_dict().items()}
    for index, state in optimizer.state_dict()["state"].items():
        for name, value in state.items():
            tensors[f"{_OPTIMIZER}{index}.{name}"] = value
    return {name: value.contiguous() for name, value in tensors.items()}


def restore(
    tensors: dict[str, Tensor], network: nn.Module, optimizer: torch.optim.Optimizer
) -> None:
    """Sets network and optimizer in place.

    Raises:
        KeyError, ValueError, RuntimeError: the tensors are another network's.
    """
    _set_network(network, tensors)
    restored = optimizer.state_dict()
    restored["state"] = _optimizer_state(tensors)
    optimizer.load_state_dict(restored)


def decode_checkpoint(data: bytes, network: nn.Module, optimizer: torch.optim.Optimizer) -> int:
    """Restores network and optimizer in place.

    Returns:
        The number of policy updates done.

    Raises:
        CheckpointError: the bytes are damaged, of another network or of another version.
    """
    try:
        tensors = _read(data)
        done = _done(tensors[_ITERATION])
        restore(tensors, network, optimizer)
    except _DAMAGED as error:
        raise CheckpointError(f"{error}; {REMEDY}") from error
    return done


def decode_network(data: bytes, network: nn.Module) -> None:
    """Restores the network alone, in place, from a checkpoint of whatever run.

    Raises:
        CheckpointError: the bytes are damaged, of another network or of another version.
    """
    try:
        _set_network(network, _read(data))
    except _DAMAGED as error:
        raise CheckpointError(str(error)) from error


_DAMAGED = (SafetensorError, KeyError, ValueError, RuntimeError, OverflowError, struct.error)


def _read(data: bytes) -> dict[str, Tensor]:
    tensors = load(data)
    _check_metadata(_metadata(data), tensors)
    return tensors


REMEDY = "remove checkpoint.safetensors to train the run from its beginning, where its episodes count again"


def _metadata(data: bytes) -> dict[str, Any] | None:
    """What the header of a safetensors file says beside its arrays; None: nothing."""
    (length,) = struct.unpack_from("<Q", data)
    found: dict[str, Any] | None = json.loads(data[8 : 8 + length]).get("__metadata__")
    return found


def _check_metadata(metadata: dict[str, Any] | None, tensors: dict[str, Tensor]) -> None:
    if metadata is None:
        log.warning("the checkpoint is of schema 1 and has no digest: it is taken as it is")
        return
    if metadata.get("schema") != str(SCHEMA):
        raise ValueError(
            f"checkpoint schema {str(metadata.get('schema'))[:20]}, bpn {VERSION} reads 1 and {SCHEMA}"
        )
    if metadata.get("sha256") != _digest(tensors):
        raise ValueError(
            "the checkpoint was altered since it was written: its SHA-256 is another one"
        )


def _done(iteration: Tensor) -> int:
    if iteration.dtype != torch.int64 or iteration.shape != ():
        raise ValueError(f"iteration is {iteration.dtype}{list(iteration.shape)}, not one int64")
    done = int(iteration)
    if not 0 <= done < _MAX_ITERATION:
        raise ValueError(f"iteration = {done} is none")
    return done


def _digest(tensors: dict[str, Tensor]) -> str:
    return arrays_digest(
        (name, str(value.dtype), value.shape, value.cpu().contiguous().numpy().tobytes())
        for name, value in tensors.items()
    )


def _set_network(network: nn.Module, tensors: dict[str, Tensor]) -> None:
    """Torch's own error of another network has a line for each array; this one has the first that differs."""
    given = _part(tensors, _NETWORK)
    for name, own in network.state_dict().items():
        if name not in given:
            raise ValueError(f"it is of another network: it has no {name}")
        if given[name].shape != own.shape:
            shapes = f"{[*given[name].shape]}, the run's {[*own.shape]}"
            raise ValueError(f"it is of another network: its {name} is {shapes}")
    network.load_state_dict(given)


def _part(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {
        name.removeprefix(prefix): value
        for name, value in tensors.items()
        if name.startswith(prefix)
    }


def _optimizer_state(tensors: dict[str, Tensor]) -> dict[int, dict[str, Any]]:
    state: dict[int, dict[str, Any]] = {}
    for name, value in _part(tensors, _OPTIMIZER).items():
        index, key = name.split(".", 1)
        state.setdefault(int(index), {})[key] = value
    return state
