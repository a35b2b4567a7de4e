"""Learners that share every minibatch of a policy update: whose part is whose, and the sums they exchange."""

from time import perf_counter
from typing import Any, Protocol

from torch import Tensor


class GroupLostError(RuntimeError):
    """Another member died or keeps silent: the update cannot be finished and must be given up."""


class Group(Protocol):
    """The learners of one policy update, each with a part of every minibatch.

    Attributes:
        size: how many there are.
    """

    @property
    def size(self) -> int: ...

    def shard(self, batch: Tensor) -> Tensor:
        """This member's transitions of a minibatch; parts differ in size by 1 at most and may be empty."""

    def all_reduce_sum(self, values: Tensor) -> None:
        """Replaces values by their sums over all members, which get the same bits.

        Raises:
            GroupLostError: not every member took part.
        """


class SingleProcess:
    """A learner that shares with nobody."""

    size = 1

    def shard(self, batch: Tensor) -> Tensor:
        """All of it."""
        return batch

    def all_reduce_sum(self, values: Tensor) -> None:
        """Nothing: the sums are complete."""


SINGLE_PROCESS = SingleProcess()


class DistributedGroup:
    """A group over torch.distributed: gloo, or nccl where the tensors are on GPUs.

    It holds the only reference to what connects the members, so that `close` cuts the connections, by which
    the others notice.

    Attributes:
        exchange_s: how long this member has spent in exchanges, waiting for the others included.

    Args:
        backend: torch's process group.
        rank: which member this is, from 0.
    """

    def __init__(self, backend: Any, rank: int, size: int) -> None:
        self._backend = backend
        self.rank, self.size = rank, size
        self.exchange_s = 0.0

    def shard(self, batch: Tensor) -> Tensor:
        """The rank-th of `size` neighbouring pieces."""
        return batch.tensor_split(self.size)[self.rank]

    def all_reduce_sum(self, values: Tensor) -> None:
        """Each sum is formed in one place and then told to all: equal bits everywhere."""
        self._exchange("allreduce", values)

    def broadcast(self, values: Tensor) -> None:
        """Replaces values by those of rank 0.

        Raises:
            GroupLostError: not every member took part.
        """
        self._exchange("broadcast", values)

    def _exchange(self, collective: str, values: Tensor) -> None:
        if self._backend is None:
            raise GroupLostError(f"{collective}: this member has left the group")
        began_s = perf_counter()
        try:
            getattr(self._backend, collective)([values]).wait()
        except RuntimeError as error:
            raise GroupLostError(f"{collective}: {brief(error)}") from error
        self.exchange_s += perf_counter() - began_s

    def close(self) -> None:
        """Leaves the group."""
        self._backend = None


def brief(error: RuntimeError) -> str:
    """What torch says of a failed connection, without its advice."""
    return str(error).splitlines()[0].split(". This ")[0]
