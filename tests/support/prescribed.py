"""Which actions a run's episodes must have: what policy, outputs, lambda, beta, epsilon, seed and step prescribe.

Plain and slow on purpose, and without the edge's own code.
"""

import numpy as np

from bpn_shared.config import RunConfig
from bpn_shared.messages.episode import Episode
from bpn_shared.runs.folder import RunFolder
from bpn_shared.seeds import action_uniform, episode_seed
from bpn_shared.weights import decode_weights

_ROUNDING = 1e-9


def check_actions(folder: RunFolder) -> int:
    """Compares every action of every stored episode; returns how many there were."""
    config, actions = folder.config(), 0
    for path in sorted((folder.path / "episodes").glob("*.bpne")):
        episode = Episode.decode(path.read_bytes(), config.task_spec)
        meta = episode.meta
        assert meta.seed == episode_seed(config.seed, meta.iteration, meta.episode)
        weights = decode_weights(folder.weights_path(meta.weights_version).read_bytes())
        check_episode(config, episode, float(weights.scale))
        actions += episode.steps
    return actions


def check_episode(config: RunConfig, episode: Episode, scale: float) -> None:
    """Compares every action of an episode that was played with weights of this lambda."""
    softmax = config.algorithm in ("bpn", "cvi", "dpp")
    epsilon = config.epsilon(episode.meta.iteration)
    numbers = [action_uniform(episode.meta.seed, step) for step in range(episode.steps)]
    assert len(set(numbers)) == len(numbers)
    for step, (action, outputs, number) in enumerate(
        zip(episode.actions.tolist(), episode.outputs.astype(float), numbers, strict=True)
    ):
        at = f"step {step} of episode ({episode.meta.iteration}, {episode.meta.episode})"
        if softmax:
            preferences = config.beta * scale * outputs
            weights = np.exp(preferences - preferences.max())
            passed = np.concatenate([[0.0], np.cumsum(weights / weights.sum())])
            assert passed[action] - _ROUNDING <= number <= passed[action + 1] + _ROUNDING, at
        elif number < epsilon:
            assert action == int(number / epsilon * len(outputs)), at
        else:
            assert action == int(np.argmax(outputs)), at
