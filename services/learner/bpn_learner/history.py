"""What a run's folder says of iterations that are done, and whether what is computed now agrees with it.

Whatever can be compared is compared: a resumed run has exactly the data and the policy that it had, or an error.
"""

import logging
from dataclasses import replace
from typing import Any

import numpy as np

from bpn_learner.checkpoint import (
    REMEDY,
    CheckpointError,
    decode_checkpoint,
    decode_network,
)
from bpn_learner.episodes import DataError, Scored
from bpn_learner.factory import initial_policy
from bpn_learner.networks import PNetwork
from bpn_shared.bnn.envelope import BlobError
from bpn_shared.bnn.weights import Weights
from bpn_shared.runs.folder import RunFolder
from bpn_shared.runs.warm_start import FILE as INITIAL
from bpn_shared.spec.config import RunConfig

log = logging.getLogger(__name__)

_TOLERANCE = 2e-3
"""Between rewards that were rounded to three digits."""


class History:
    """The past of one run, read when an attempt begins."""

    def __init__(self, config: RunConfig, folder: RunFolder) -> None:
        self._config, self._folder = config, folder
        self._records: dict[int, dict[str, Any]] = {r["iteration"]: r for r in folder.metrics()}
        self._rewards = folder.rewards()
        self.is_repeatable = config.pacing == "lockstep" and config.device == "cpu"
        """Whether what is done again comes out the same, bit by bit."""

    def transitions(self, iteration: int) -> int:
        """How many an iteration that is done has."""
        return int(self._records.get(iteration, {}).get("transitions", 0))

    def reward_scale(self, done: int) -> float:
        """What the updates found out to be the factor on rewards; 0: nothing yet.

        Raises:
            CheckpointError: it is lost, and preferences are in its unit.
        """
        if not done or self._config.reward_scale:
            return 0.0
        found = self._records.get(done - 1, {}).get("reward_scale")
        if not isinstance(found, int | float):
            raise CheckpointError(
                f"metrics.jsonl has lost iteration {done - 1}, which told the factor on rewards that the run had "
                "found out (reward_scale = 0): it cannot be gone on with; start a new run"
            )
        return float(found)

    def load_policy(self) -> "tuple[PNetwork, Any, int]":
        """Network, optimizer and the number of updates done, of the checkpoint or else of the beginning.

        Raises:
            CheckpointError: there is a checkpoint, but not one to go on from.
        """
        network, optimizer = self._beginning()
        path = self._folder.checkpoint_path
        try:
            data = self._folder.read_file(path.name)
        except FileNotFoundError:
            if self._records:
                log.warning(
                    "%s is missing: trains from the beginning, with the episodes there are", path
                )
            return network, optimizer, 0
        except OSError as error:
            raise CheckpointError(
                f"{path} cannot be resumed from: {error.strerror}; {REMEDY}"
            ) from error
        try:
            done = decode_checkpoint(data, network, optimizer)
        except CheckpointError as error:
            raise CheckpointError(f"{path} cannot be resumed from: {error}") from error
        network.eval()
        return network, optimizer, done

    def _beginning(self) -> "tuple[PNetwork, Any]":
        """Network and optimizer before the first update: the network may be another run's."""
        network, optimizer = initial_policy(self._config)
        if not self._config.init_from:
            return network, optimizer
        run, version, sha256 = self._config.init_from.split(":")
        path = self._folder.path / INITIAL
        try:
            decode_network(self._folder.read_file(path.name), network)
        except (OSError, CheckpointError) as error:
            raise CheckpointError(
                f"{path}, what the run begins with, cannot be read: {error}; start a new run"
            ) from error
        network.eval()
        found = network.export().content_sha256()
        if found != sha256 and self._config.device == "cpu":
            raise CheckpointError(
                f"{path} holds other weights (SHA-256 {found}) than version {version} of run {run}, {sha256}; "
                "start a new run"
            )
        return network, optimizer

    def check_policy(self, network: PNetwork, done: int) -> None:
        """Compares a restored network with what the folder says that the last update came to.

        Raises:
            CheckpointError: it is another one.
        """
        path = self._folder.checkpoint_path
        if done > self._config.iterations:
            raise CheckpointError(
                f"{path} tells of {done} updates, the run has {self._config.iterations}; {REMEDY}"
            )
        missing = sorted(set(range(done)) - self._records.keys())
        if missing:
            log.warning("metrics.jsonl has lost the iterations %s", ", ".join(map(str, missing)))
        expected, found = self.weights_sha256(done), network.export().content_sha256()
        if expected is not None and found != expected:
            message = (
                f"{path} holds other weights than version {done}, which the run's files tell of"
            )
            if self._config.device == "cpu":
                raise CheckpointError(f"{message}; {REMEDY}")
            log.warning("%s: another device rounds otherwise", message)

    def weights_sha256(self, version: int) -> str | None:
        """What the content of a version was; None where nothing tells."""
        told = self._records.get(version - 1, {}).get("weights_sha256")
        if isinstance(told, str):
            return told
        try:
            return self._folder.weights(version).content_sha256()
        except (OSError, BlobError):
            return None

    def weights(self, version: int, attempt: int) -> Weights:
        """A version as it was, for an iteration that is played again, in the name of an attempt.

        Raises:
            DataError: it is lost.
        """
        path = self._folder.weights_path(version)
        try:
            weights = self._folder.weights(version)
        except (OSError, BlobError) as error:
            if version > 0:
                raise DataError(
                    f"episodes of iteration {version} are missing and cannot be played again: {path}: "
                    f"{error}; {REMEDY}"
                ) from error
            weights = self._beginning()[0].export()
        told = self._records.get(version - 1, {}).get("weights_sha256")
        if version != 0 and (
            weights.version != version or told not in (None, weights.content_sha256())
        ):
            raise DataError(
                f"episodes of iteration {version} are missing and cannot be played again: {path} is not "
                f"version {version} of this run; {REMEDY}"
            )
        return replace(weights, run=self._folder.run, attempt=attempt, version=version)

    def check_rewards(
        self, iteration: int, episodes: list[Scored], rewards_px: list[list[float]]
    ) -> bool:
        """Compares an iteration's rewards with those that were kept when it was first collected.

        What was played again in realtime is another episode, and is not compared.

        Returns:
            Whether they are kept already.

        Raises:
            DataError: they are others.
        """
        kept = self._rewards.get(iteration)
        if kept is None:
            return False
        same = [_equal(*pair) for pair in zip(kept, rewards_px, strict=False)]
        same += [False] * (len(rewards_px) - len(same))
        for index, (scored, is_same) in enumerate(zip(episodes, same, strict=True)):
            if not is_same and (scored.kept or self.is_repeatable):
                raise DataError(
                    f"episode ({iteration}, {index}) has other rewards than rewards.jsonl says: this program "
                    "computes them otherwise than the one that collected it, or its file is not the one that was "
                    "stored. Go on with that program, or start a new run"
                )
        return all(same)


def _equal(kept: object, found: list[float]) -> bool:
    try:
        return np.allclose(np.asarray(kept, np.float64), found, rtol=1e-6, atol=_TOLERANCE)
    except (ValueError, TypeError):  # of another length, or no numbers
        return False
