"""The checkpoint: everything that the next iteration needs and that cannot be derived.

One safetensors file, replaced atomically. Random numbers need no state (`bpn_shared.seeds`), and the data
sets are the run folder's episodes, on disk since before they were acknowledged.
"""

from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor, nn

from bpn_shared.runs.files import write_atomically

_NETWORK, _OPTIMIZER = "network.", "optimizer."


class CheckpointError(RuntimeError):
    """The checkpoint cannot be used; the message names the file and what to do."""


def save_checkpoint(
    path: Path, network: nn.Module, optimizer: torch.optim.Optimizer, iteration: int
) -> None:
    """Writes the state after `iteration` policy updates."""
    write_atomically(
        path, save(state_tensors(network, optimizer) | {"iteration": torch.tensor(iteration)})
    )


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
    network.load_state_dict(_part(tensors, _NETWORK))
    restored = optimizer.state_dict()
    restored["state"] = _optimizer_state(tensors)
    optimizer.load_state_dict(restored)


def load_checkpoint(path: Path, network: nn.Module, optimizer: torch.optim.Optimizer) -> int:
    """Restores network and optimizer in place.

    Returns:
        The number of policy updates done.

    Raises:
        CheckpointError: the file is damaged or of another network.
    """
    try:
        tensors = load(path.read_bytes())
        restore(tensors, network, optimizer)
        return int(tensors["iteration"])
    except (SafetensorError, KeyError, ValueError, RuntimeError) as error:
        raise CheckpointError(
            f"{path} cannot be resumed from: {error}. Remove it to train the run from its beginning; "
            "its episodes are kept"
        ) from error


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
