"""A run's random numbers, from their definition: Philox keyed by what the number is for and where it is used.

purpose 0, an episode's seed    SeedSequence(0, run seed, iteration, episode): one uint64
purpose 1, a step's action      Philox with key (episode seed, 1), counter (step, 0, 0, 0): one double in [0, 1);
                                of D dimensions D doubles, counters (step ceil(D/4) and on, 0, 0, 0)
purpose 2, the order of D       SeedSequence(2, run seed, iteration): one permutation an epoch
purpose 3, initial weights      SeedSequence(3, run seed): one integer below 2**63, the seed of torch's generator
purpose 7, pictures once more   SeedSequence(7, run seed, iteration, episode of D): one uint64
"""

import numpy as np


def keyed(*key: int) -> np.random.Generator:
    """The generator of purposes 0, 2, 3 and 7."""
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(list(key))))


def episode_seed(run_seed: int, iteration: int, episode: int) -> int:
    return int(keyed(0, run_seed, iteration, episode).integers(2**64, dtype=np.uint64))


def step_uniforms(seed: int, steps: int, dims: int = 1) -> list[list[float]]:
    """For every step of an episode of that seed, one for each dimension of the action."""
    key, blocks = np.array([seed, 1], dtype=np.uint64), (dims + 3) // 4
    streams = (np.random.Philox(key=key, counter=[step * blocks, 0, 0, 0]) for step in range(steps))
    return [np.random.Generator(stream).random(dims).tolist() for stream in streams]


def shuffles(run_seed: int, iteration: int) -> np.random.Generator:
    return keyed(2, run_seed, iteration)


def camera_seed(run_seed: int, iteration: int, episode: int) -> int:
    return int(keyed(7, run_seed, iteration, episode).integers(2**64, dtype=np.uint64))


def initial_seed(run_seed: int) -> int:
    return int(keyed(3, run_seed).integers(2**63))
