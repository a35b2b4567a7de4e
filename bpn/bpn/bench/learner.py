"""`bpn bench learner`: minibatch updates per second, beside the plain loop and Stable-Baselines3's DQN.

Tracking's network and data set, one core, one thread. An update is everything from drawing a minibatch out
of memory to the optimizer's step. The candidates take turns in each round, so that what else the machine
does meets all of them; reported are the medians of the rounds, and of the ratios within a round. Pictures are
noise, on which nothing can be saved, and beside it discs on black, as a simulator draws them.
"""

import statistics
import warnings
from collections.abc import Callable
from importlib.metadata import version
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from rich.console import Console
from rich.table import Table

from bpn.bench.machine import machine, one_core
from bpn.bench.peers import stable_baselines3_updates
from bpn_learner.minibatch import available_paths
from bpn_learner.networks import make_network
from bpn_learner.transitions import EpisodeData, Transitions
from bpn_learner.update import UpdateConfig, make_optimizer, policy_update
from bpn_shared.spec.algorithms import NetworkKind
from bpn_shared.spec.network import NetworkSpec
from bpn_shared.spec.sections import Backend

SPEC = NetworkSpec(channels=6, hidden_units=100, actions=7)  # tracking, section V
EPISODES, STEPS, FRAMES_STACKED = 30, 40, 2  # D = U E T transitions
BATCH = 32
ROUNDS = 7
TARGETS = {"over_plain": 4.0, "over_stable_baselines3": 8.0}
_EPOCHS: dict[Backend, int] = {"native": 5, "torch": 3}
_PEER_UPDATES = 80
_DISC_PX = 5
_PEER = "stable-baselines3 DQN"

Frames = npt.NDArray[np.uint8]
Rate = Callable[[], float]


def run(rounds: int = ROUNDS) -> dict[str, Any]:
    """Measures all candidates.

    Returns:
        network, batch, transitions, rounds, path (of the kernel), candidates (name to updates_per_s and
        the ratio of ours to it), targets, versions, machine.

    Raises:
        RuntimeError: Stable-Baselines3 is not installed.
    """
    measured_on = machine()  # its load before the measurement adds its own
    torch.set_num_threads(1)
    with one_core():
        candidates: dict[str, Rate] = {}
        kinds: tuple[tuple[str, NetworkKind], ...] = (("", "binary"), (", float network", "float"))
        for of, kind in kinds:
            for pictures, draw in (("", _noise), (", discs on black", _discs)):
                D = _transitions(draw)
                candidates[f"bpn fast{of}{pictures}"] = _ours(kind, "native", D)
                candidates[f"bpn plain{of}{pictures}"] = _ours(kind, "torch", D)
        candidates[_PEER] = _peer()
        measured = [{name: rate() for name, rate in candidates.items()} for _ in range(rounds)]
    results = {
        name: {
            "updates_per_s": round(statistics.median(rates[name] for rates in measured), 1),
            "ratio": round(
                statistics.median(rates["bpn fast"] / rates[name] for rates in measured), 2
            ),
        }
        for name in candidates
    }
    return {
        "network": str(SPEC),
        "batch": BATCH,
        "transitions": len(D),
        "rounds": rounds,
        "path": available_paths()[0],
        "candidates": results,
        "over_plain": results["bpn plain"]["ratio"],
        "over_stable_baselines3": results[_PEER]["ratio"],
        "targets": TARGETS,
        "versions": {name: version(name) for name in ("numpy", "stable-baselines3", "torch")},
        "machine": measured_on,
    }


def _noise(rng: np.random.Generator, shape: tuple[int, ...]) -> Frames:
    return rng.integers(0, 256, shape, np.uint8)


def _discs(rng: np.random.Generator, shape: tuple[int, ...]) -> Frames:
    """Two in each frame [n, channels, rows, columns]."""
    frames = np.zeros(shape, np.uint8)
    rows, columns = np.ogrid[: shape[2], : shape[3]]
    for frame in frames:
        for y, x in rng.integers(_DISC_PX, np.array(shape[2:]) - _DISC_PX, (2, 2)):
            inside = (rows - y) ** 2 + (columns - x) ** 2 <= _DISC_PX**2
            frame[:, inside] = rng.integers(1, 256, (shape[1], 1))
    return frames


def _transitions(draw: Callable[[np.random.Generator, tuple[int, ...]], Frames]) -> Transitions:
    rng = np.random.default_rng(0)
    frame = (SPEC.channels // FRAMES_STACKED, *SPEC.observation_shape[1:])
    episodes = [
        EpisodeData(
            frames=draw(rng, (STEPS + 1, *frame)),
            actions=rng.integers(0, SPEC.actions, STEPS),
            rewards=rng.normal(size=STEPS),
            terminated=False,
        )
        for _ in range(EPISODES)
    ]
    return Transitions.from_episodes(episodes, frames_stacked=FRAMES_STACKED)


def _ours(kind: NetworkKind, backend: Backend, D: Transitions) -> Rate:
    """The epochs of `policy_update` but its first, which also warms up."""
    generator = torch.Generator().manual_seed(0)
    network = make_network(kind, SPEC, scale_initial=0.2, generator=generator)
    optimizer = make_optimizer(network, 1e-3)
    settings = UpdateConfig(epochs=_EPOCHS[backend], batch_size=BATCH, backend=backend)
    rng = np.random.default_rng(0)

    def rate() -> float:
        ends_s: list[float] = []
        report = policy_update(
            network, optimizer, D, settings, rng,
            progress=lambda _done, _total: ends_s.append(perf_counter()),
        )  # fmt: skip
        updates = report.updates * (len(ends_s) - 1) / len(ends_s)
        return updates / (ends_s[-1] - ends_s[0])

    return rate


def _peer() -> Rate:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # advice on installing what is not used
        update = stable_baselines3_updates(SPEC, EPISODES * STEPS, BATCH)

    def rate() -> float:
        update(_PEER_UPDATES // 10)
        start_s = perf_counter()
        update(_PEER_UPDATES)
        return _PEER_UPDATES / (perf_counter() - start_s)

    return rate


def met(result: dict[str, Any]) -> bool:
    """Whether the measurement reaches its targets."""
    return all(result[name] >= target for name, target in TARGETS.items())


def show(result: dict[str, Any]) -> None:
    """Prints the measurement as a table."""
    versions = ", ".join(f"{name} {number}" for name, number in result["versions"].items())
    load = result["machine"]["load_average"][0]
    table = Table(
        "learner",
        title=f"updates per second, {result['network']}, B={BATCH}, one thread",
        caption=f"{result['machine']['cpu']}, {result['path']}, load {load}, {versions}",
    )
    for heading in ("updates/s", "fast is x times"):
        table.add_column(heading, justify="right")
    for name, values in result["candidates"].items():
        table.add_row(name, f"{values['updates_per_s']:.0f}", f"{values['ratio']:.2f}")
    Console().print(table)
