"""Every random number of a run, each a pure function of the run's seed and where it is used.

Nothing has generator state, so a restart anywhere cannot change what comes next, and whichever robot or
edge plays an episode plays the same one.
"""

import numpy as np
import numpy.typing as npt

# one stream for each purpose
_EPISODE, _ACTION, _SHUFFLE, _INITIAL, _DISTURBANCE, _PIXEL, _LATENCY, _AUGMENTATION = range(8)
_BLOCK = 4
"""Numbers that Philox makes at once."""


def _generator(*key: int) -> np.random.Generator:
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(key)))


def episode_seed(run_seed: int, iteration: int, episode: int) -> int:
    """Seed (uint64) of an episode: the robot's start and the actions drawn in it."""
    return int(_generator(_EPISODE, run_seed, iteration, episode).integers(2**64, dtype=np.uint64))


def action_uniforms(episode_seed: int, steps: int) -> npt.NDArray[np.float64]:
    """The uniform numbers in [0, 1) that decide the actions of steps 0 to T - 1, float64[T].

    Philox counts: step t has the first number of block t of the episode's key, whichever steps are asked for.
    """
    return choice_uniforms(episode_seed, steps, 1)[:, 0]


def choice_uniforms(episode_seed: int, steps: int, dims: int) -> npt.NDArray[np.float64]:
    """The same for actions of several dimensions, float64[T, D]; up to four need no other block than one's."""
    blocks = -(-dims // _BLOCK)
    # as an array: a list with a number of 2**63 and above would become float64 and lose its last bits
    philox = np.random.Philox(key=np.array([episode_seed, _ACTION], np.uint64))
    return np.random.Generator(philox).random((steps, blocks * _BLOCK))[:, :dims]


def disturbance_uniforms(episode_seed: int, kinds: int) -> npt.NDArray[np.float64]:
    """What an episode draws of its disturbances: numbers in [0, 1), float64[kinds, 4], each kind's its own."""
    philox = np.random.Philox(key=np.array([episode_seed, _DISTURBANCE], np.uint64))
    return np.random.Generator(philox).random((kinds, _BLOCK))


def latency_uniforms(episode_seed: int, steps: int) -> npt.NDArray[np.float64]:
    """What decides how late the actions of steps 0 to T - 1 act, in [0, 1), float64[T]."""
    philox = np.random.Philox(key=np.array([episode_seed, _LATENCY], np.uint64))
    return np.random.Generator(philox).random((steps, _BLOCK))[:, 0]


def pixel_generator(episode_seed: int, step: int) -> np.random.Generator:
    """What disturbs the pixels of one step's frame, however many numbers another's takes."""
    key = np.array([episode_seed, _PIXEL], np.uint64)
    return np.random.Generator(
        np.random.Philox(key=key, counter=np.array([0, 0, 0, step], np.uint64))
    )


def shuffle_generator(run_seed: int, iteration: int) -> np.random.Generator:
    """What shuffles D in the policy update of an iteration."""
    return _generator(_SHUFFLE, run_seed, iteration)


def augmentation_seed(run_seed: int, iteration: int, episode: int) -> int:
    """Seed (uint64) of what an iteration's update draws anew for the pictures of an episode of its D."""
    of = _generator(_AUGMENTATION, run_seed, iteration, episode)
    return int(of.integers(2**64, dtype=np.uint64))


def initial_weights_seed(run_seed: int) -> int:
    """Seed (below 2**63) of the network's initial weights."""
    return int(_generator(_INITIAL, run_seed).integers(2**63))
