"""What rank 0 tells the other learners of a group as an update begins: everything that they need for it.

They keep nothing from one update to the next and need no run folder, so whoever comes in place of another
one is as good, wherever it runs.
"""

from dataclasses import fields

import torch
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor, nn

from bpn_learner.checkpoint import restore, state_tensors
from bpn_learner.gathering import RegressionBatch
from bpn_learner.group import DistributedGroup, GroupLostError

_REGRESSION, _ITERATION = "regression.", "iteration"
MAX_BYTES = 16 * 2**30


def broadcast_state(
    group: DistributedGroup,
    network: nn.Module,
    optimizer: torch.optim.Optimizer,
    regression: RegressionBatch,
    iteration: int,
) -> None:
    """Rank 0's end of `receive_state`.

    Raises:
        GroupLostError: not every member took it.
    """
    tensors = state_tensors(network, optimizer)
    for field in fields(regression):
        tensors[f"{_REGRESSION}{field.name}"] = getattr(regression, field.name).contiguous()
    tensors[_ITERATION] = torch.tensor(iteration)
    device = regression.y.device
    data = torch.frombuffer(bytearray(save(tensors)), dtype=torch.uint8).to(device)
    group.broadcast(torch.tensor([len(data)], device=device))
    group.broadcast(data)


def receive_state(
    group: DistributedGroup, network: nn.Module, optimizer: torch.optim.Optimizer
) -> tuple[RegressionBatch, int]:
    """Sets network and optimizer to rank 0's.

    Returns:
        What to fit, and the iteration.

    Raises:
        GroupLostError: rank 0 is gone, or told something else.
    """
    device = next(network.parameters()).device
    size = torch.zeros(1, dtype=torch.int64, device=device)
    group.broadcast(size)
    if not 0 < int(size) <= MAX_BYTES:
        raise GroupLostError(f"rank 0 tells {int(size)} bytes, at most {MAX_BYTES} are taken")
    data = torch.empty(int(size), dtype=torch.uint8, device=device)
    group.broadcast(data)
    try:
        tensors: dict[str, Tensor] = load(data.cpu().numpy().tobytes())
        restore(tensors, network, optimizer)
        parts = {
            field.name: tensors[f"{_REGRESSION}{field.name}"] for field in fields(RegressionBatch)
        }
        regression = RegressionBatch(**{name: part.to(device) for name, part in parts.items()})
        return regression, int(tensors[_ITERATION])
    except (SafetensorError, KeyError, ValueError, RuntimeError) as error:
        raise GroupLostError(f"rank 0 tells what is no update of this run: {error}") from error
