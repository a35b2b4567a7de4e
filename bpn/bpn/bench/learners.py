"""`bpn bench learners`: minibatch updates per second of one learner, and of several that share minibatches.

Tracking's network, one thread and a core of its own for each learner, connected over loopback. For every
minibatch size one learner alone and the group take turns; reported are the medians of the rounds.
"""

import multiprocessing
import os
import socket
import statistics
from collections.abc import Sequence
from datetime import timedelta
from time import perf_counter, process_time
from typing import Any, NamedTuple

import numpy as np
import torch
from rich.console import Console
from rich.table import Table

from bpn.bench.learner import SPEC
from bpn.bench.machine import machine
from bpn_learner.gathering import RegressionBatch
from bpn_learner.group import SINGLE_PROCESS, DistributedGroup, Group
from bpn_learner.minibatch import available_paths
from bpn_learner.networks import make_network
from bpn_learner.rendezvous import connect, open_store
from bpn_learner.update import UpdateConfig, fit, make_optimizer
from bpn_shared.spec.config import RunConfig

LEARNERS = 2
BATCHES = (32, 256, 1024)
ROUNDS = 5
TRANSITIONS = 2048
_EPOCHS = 3
_LOOPBACK = "127.0.0.1"
_LOAD_S = 180.0
"""How long loading torch may take on a busy machine, beyond what learners wait for each other."""


def run(
    learners: int = LEARNERS, rounds: int = ROUNDS, batches: Sequence[int] = BATCHES
) -> dict[str, Any]:
    """Measures every minibatch size.

    Returns:
        network, learners, rounds, path (of the kernel), transitions, batches (size to updates per second alone
        and shared, their ratio, and the milliseconds of processor time that one learner then spends on an
        update, which do not depend on what else the machine does), machine.
    """
    measured_on = machine()  # its load before the measurement adds its own
    cores = os.sched_getaffinity(0)
    with socket.create_server((_LOOPBACK, 0)) as listening:
        port: int = listening.getsockname()[1]
        store = open_store(_LOOPBACK, port, listening.detach())
    spawn = multiprocessing.get_context("spawn")
    others = [
        spawn.Process(target=_member, args=(rank, learners, port, rounds, batches), daemon=True)
        for rank in range(1, learners)
    ]
    for other in others:
        other.start()
    store.wait([f"ready-{rank}" for rank in range(1, learners)], timedelta(seconds=_LOAD_S))
    try:
        _take_core(0)
        group = connect(store, _LOOPBACK, 0, _config(learners))
        measured = {str(batch): _measure(group, batch, rounds) for batch in batches}
        group.close()
    finally:
        os.sched_setaffinity(0, cores)
        for other in others:
            other.join(10.0)
            other.kill()
    return {
        "network": str(SPEC),
        "learners": learners,
        "rounds": rounds,
        "path": available_paths()[0],
        "transitions": TRANSITIONS,
        "batches": measured,
        "machine": measured_on,
    }


def _member(rank: int, learners: int, port: int, rounds: int, batches: Sequence[int]) -> None:
    """The process of another learner: what rank 0 measures, it does too."""
    _take_core(rank)
    store = open_store(_LOOPBACK, port)
    store.set(f"ready-{rank}", "")
    group = connect(store, _LOOPBACK, rank, _config(learners))
    for batch in batches:
        for _ in range(rounds):
            group.all_reduce_sum(torch.zeros(1))  # rank 0 has measured itself alone
            _measured(group, batch)
    group.close()


def _measure(group: DistributedGroup, batch: int, rounds: int) -> dict[str, float]:
    alone: list[_Measured] = []
    shared: list[_Measured] = []
    for _ in range(rounds):
        alone.append(_measured(SINGLE_PROCESS, batch))
        group.all_reduce_sum(torch.zeros(1))
        shared.append(_measured(group, batch))
    ratios = [a.update_s / s.update_s for s, a in zip(shared, alone, strict=True)]
    return {
        "alone_updates_per_s": round(1 / statistics.median(m.update_s for m in alone), 1),
        "shared_updates_per_s": round(1 / statistics.median(m.update_s for m in shared), 1),
        "ratio": round(statistics.median(ratios), 2),
        "alone_cpu_ms": round(1e3 * statistics.median(m.cpu_s for m in alone), 2),
        "shared_cpu_ms": round(1e3 * statistics.median(m.cpu_s for m in shared), 2),
    }


class _Measured(NamedTuple):
    """Seconds an update, by the clock and of this learner's processor time."""

    update_s: float
    cpu_s: float


def _measured(group: Group, batch: int) -> _Measured:
    """Over all epochs but the first, which also warms up."""
    rng = np.random.default_rng(0)
    network = make_network(
        "binary", SPEC, scale_initial=0.2, generator=torch.Generator().manual_seed(0)
    )
    frames = rng.integers(
        0, 256, (TRANSITIONS, SPEC.channels, *SPEC.observation_shape[1:]), np.uint8
    )
    regression = RegressionBatch(
        frames=torch.from_numpy(frames),
        observations=torch.arange(TRANSITIONS)[:, None],
        actions=torch.from_numpy(rng.integers(0, SPEC.actions, TRANSITIONS)),
        y=torch.from_numpy(rng.normal(size=TRANSITIONS).astype(np.float32)),
    )
    ends: list[_Measured] = []
    fit(
        network,
        make_optimizer(network, 1e-3),
        regression,
        UpdateConfig(epochs=_EPOCHS, batch_size=batch),
        rng,
        group=group,
        progress=lambda _done, _total: ends.append(_Measured(perf_counter(), process_time())),
    )
    updates = (len(ends) - 1) * (TRANSITIONS // batch)
    clock_s, cpu_s = (end - begin for begin, end in zip(ends[0], ends[-1], strict=True))
    return _Measured(clock_s / updates, cpu_s / updates)


def _config(learners: int) -> RunConfig:
    return RunConfig.for_task("tracking", learners=learners)


def _take_core(rank: int) -> None:
    torch.set_num_threads(1)
    cores = sorted(os.sched_getaffinity(0))
    os.sched_setaffinity(0, {cores[rank % len(cores)]})


def met(_result: dict[str, Any]) -> bool:
    """There is no target: what it gives depends on cores and network."""
    return True


def show(result: dict[str, Any]) -> None:
    """Prints the measurement as a table."""
    load = result["machine"]["load_average"][0]
    table = Table(
        "B",
        title=f"updates per second, {result['network']}, 1 and {result['learners']} learners",
        caption=f"{result['machine']['cpu']}, {result['path']}, load {load}",
    )
    for heading in ("alone", "shared", "ratio", "CPU alone", "CPU shared"):
        table.add_column(heading, justify="right")
    for batch, values in result["batches"].items():
        table.add_row(
            batch,
            f"{values['alone_updates_per_s']:.0f}",
            f"{values['shared_updates_per_s']:.0f}",
            f"{values['ratio']:.2f}",
            f"{values['alone_cpu_ms']:.1f} ms",
            f"{values['shared_cpu_ms']:.1f} ms",
        )
    Console().print(table)
