"""Episodes of the reaching task as an edge would deliver them, and a learner's end of a run folder."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from uuid import UUID

import numpy as np

from bpn_shared.messages.episode import Episode, EpisodeMeta
from bpn_shared.runs.folder import RunFolder
from bpn_shared.runs.ownership import Ownership
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.seeds import episode_seed
from bpn_tasks.markers import HAND_LEVEL, TARGET_LEVEL

CONFIG = RunConfig.for_task(
    "reaching",
    seed=3,
    iterations=4,
    episodes=4,
    steps=2,
    epochs=1,
    batch_size=2,
    hidden_units=1,
    replay_iterations=2,
)
TASK = CONFIG.task_spec


def episode(
    iteration: int,
    index: int,
    steps: int = 2,
    outputs: type = np.int32,
    rewards: float = np.nan,
    black: bool = False,
    **changes: Any,
) -> Episode:
    """An episode of `CONFIG`, other in every (iteration, index).

    Args:
        rewards: as the robot tells them.
        black: its frames show nothing.
        changes: of its description.
    """
    meta = EpisodeMeta(
        iteration=iteration, episode=index, seed=episode_seed(CONFIG.seed, iteration, index),
        slot=0, worker="edge-0", weights_attempt=1, weights_version=iteration, terminated=False,
        deadline_misses=0, duration_ns=1,
    ).model_copy(update=changes)  # fmt: skip
    frames = np.zeros((steps + 1, *TASK.frame_shape), np.uint8)
    if not black:
        frames[:, 0, 10:14, 10:14] = TARGET_LEVEL
        for step in range(steps + 1):
            column = 20 + (7 * iteration + 3 * index + step) % 50
            frames[step, 0, 40:44, column : column + 4] = HAND_LEVEL
    return Episode(
        meta=meta,
        frames=frames,
        actions=np.full(steps, index % TASK.actions, np.uint8),
        rewards=np.full(steps, rewards),
        outputs=np.zeros((steps, TASK.actions), outputs),
        inference_ns=np.zeros(steps, np.uint32),
        camera_to_action_ns=np.zeros(steps, np.uint32),
    )


def played(iteration: int, index: int, **changes: Any) -> bytes:
    """The same as bytes."""
    return episode(iteration, index, **changes).encode()


@contextlib.contextmanager
def owned(runs_dir: Path, config: RunConfig = CONFIG) -> Iterator[Ownership]:
    """A new run, owned by the learner of its first attempt."""
    with RunFolder.create(runs_dir, UUID(int=1), config).owned("learner-1") as owner:
        owner.begin_attempt()
        yield owner
