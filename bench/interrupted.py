"""What a run of `seeds` needs to go on where it was ended: network, optimizer and D, after each iteration."""

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

from bpn_learner.checkpoint import decode_checkpoint, encode_checkpoint
from bpn_learner.networks import PNetwork
from bpn_learner.transitions import EpisodeData
from bpn_shared.runs.files import write_atomically

_CHECKPOINT, _SCALE = "checkpoint.safetensors", "reward_scale"


class State:
    """A folder with a checkpoint and the data sets, one of each iteration, that are D.

    The checkpoint comes last: what is newer than it is made again, to the same bits.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def save(
        self,
        done: int,
        network: PNetwork,
        optimizer: torch.optim.Optimizer,
        newest: Sequence[EpisodeData],
        *,
        remembered: int,
        reward_scale: float,
    ) -> None:
        """Keeps the state after `done` iterations.

        Args:
            newest: the last iteration's episodes.
            remembered: how many iterations' episodes are D, the newest among them.
            reward_scale: what was found out of it.
        """
        self._folder.mkdir(parents=True, exist_ok=True)
        arrays: dict[str, np.ndarray] = {_SCALE: np.array(reward_scale)}
        for index, episode in enumerate(newest):
            arrays |= {
                f"{index:05d}.frames": episode.frames,
                f"{index:05d}.actions": episode.actions,
                f"{index:05d}.rewards": episode.rewards,
                f"{index:05d}.terminated": np.array(episode.terminated),
            }
        np.savez_compressed(self._data_set(done - 1), **arrays)  # type: ignore[arg-type]
        checkpoint = encode_checkpoint(network, optimizer, done)
        write_atomically(self._folder / _CHECKPOINT, checkpoint)
        forgotten = self._data_set(done - 1 - remembered)
        forgotten.unlink(missing_ok=True)

    def load(
        self, network: PNetwork, optimizer: torch.optim.Optimizer
    ) -> tuple[int, list[list[EpisodeData]], float]:
        """Sets network and optimizer to what was kept, if anything was.

        Returns:
            How many iterations are done, the data sets that may be D, the oldest first, and what was found out of
            the factor on rewards.
        """
        try:
            kept = (self._folder / _CHECKPOINT).read_bytes()
        except FileNotFoundError:
            return 0, [], 0.0
        done = decode_checkpoint(kept, network, optimizer)
        network.eval()
        there = [path for i in range(done) if (path := self._data_set(i)).exists()]
        with np.load(there[-1], allow_pickle=False) as newest:
            reward_scale = float(newest[_SCALE])
        return done, [_episodes(path) for path in there], reward_scale

    def forget(self) -> None:
        """Once the run is whole."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def _data_set(self, iteration: int) -> Path:
        return self._folder / f"{iteration:06d}.npz"


def _episodes(path: Path) -> list[EpisodeData]:
    with np.load(path, allow_pickle=False) as kept:
        names = sorted({name.split(".")[0] for name in kept.files if name != _SCALE})
        return [
            EpisodeData(
                kept[f"{name}.frames"], kept[f"{name}.actions"], kept[f"{name}.rewards"],
                bool(kept[f"{name}.terminated"]),
            )
            for name in names
        ]  # fmt: skip
