"""The learner on a GPU, checked against the CPU and measured; `bench/gpu.sh` runs it.

Writes a line for each check and each measurement, and leaves with status 1 where a check fails.
"""

import statistics
import sys
from collections.abc import Callable
from contextlib import nullcontext
from time import perf_counter

import numpy as np
import torch
from torch import Tensor

from bpn.bench.peers import stable_baselines3_updates
from bpn_learner.minibatch import autograd_gradients, minibatch_gradients
from bpn_learner.networks import PNetwork, make_network
from bpn_learner.steps import CudaGraphs, RecordedStep, Step, plain_step, recordable
from bpn_learner.update import make_optimizer
from bpn_shared.spec.algorithms import NetworkKind
from bpn_shared.spec.network import NetworkSpec

SPEC = NetworkSpec(channels=6, hidden_units=100, actions=7)  # tracking, section V
TRANSITIONS, BATCH = 1200, 32
CHECKED_STEPS = 50
ROUNDS, SECONDS_A_ROUND = 5, 3.0
KINDS: tuple[NetworkKind, ...] = ("binary", "float")
Data = tuple[Tensor, Tensor, Tensor]


def data(device: str) -> Data:
    """Pixels, actions and targets, the same on every device."""
    rng = np.random.default_rng(0)
    shape = (TRANSITIONS, SPEC.image_px, SPEC.image_px, SPEC.channels)
    pixels = torch.from_numpy(rng.integers(0, 256, shape, np.uint8))
    actions = torch.from_numpy(rng.integers(0, SPEC.actions, TRANSITIONS))
    y = torch.from_numpy(rng.normal(size=TRANSITIONS).astype(np.float32))
    return pixels.to(device), actions.to(device), y.to(device)


def network_of(kind: NetworkKind, device: str) -> PNetwork:
    """The same parameters on every device, in training mode."""
    made = make_network(kind, SPEC, scale_initial=0.2, generator=torch.Generator().manual_seed(0))
    return made.to(device).train()


def gradient_of(kind: NetworkKind, device: str) -> Tensor:
    """All gradients of one minibatch in one vector, on the CPU."""
    network = network_of(kind, device)
    autograd_gradients(network, *data(device))(torch.arange(BATCH, device=device))
    return torch.cat([p.grad.flatten().cpu() for p in network.parameters() if p.grad is not None])


def learned(kind: NetworkKind, device: str, *, recorded: bool = False) -> Tensor:
    """The parameters after some steps, in one vector, on the CPU."""
    network = network_of(kind, device)
    optimizer = make_optimizer(network, 1e-3)
    step: Step = plain_step(autograd_gradients(network, *data(device)), network, optimizer)
    generator = torch.Generator().manual_seed(1)
    with recordable(optimizer) if recorded else nullcontext():
        if recorded:
            step = RecordedStep(step, CudaGraphs())
        for index in range(CHECKED_STEPS):
            size = BATCH if index % 5 else BATCH // 2  # two sizes, so two recordings
            step(torch.randint(TRANSITIONS, (size,), generator=generator).to(device))
    return torch.cat([p.detach().flatten().cpu() for p in network.parameters()])


def distance(found: Tensor, expected: Tensor) -> float:
    """Relative to the norm of what was expected."""
    return float((found - expected).norm() / expected.norm())


def check(what: str, value: float, at_most: float) -> bool:
    """Says how it went."""
    passed = value <= at_most
    print(f"{'PASS' if passed else 'FAIL'}  {what}: {value:.2e}, at most {at_most:.0e}", flush=True)
    return passed


def checks() -> list[bool]:
    """Rounding turns signs over sooner or later: after some steps networks are near each other, and no more."""
    results = []
    for kind in KINDS:
        found = distance(gradient_of(kind, "cuda"), gradient_of(kind, "cpu"))
        results.append(check(f"{kind} gradient, GPU to CPU", found, 1e-4))
        plain, recorded = learned(kind, "cuda"), learned(kind, "cuda", recorded=True)
        name = f"{kind} parameters after {CHECKED_STEPS} steps, "
        results.append(check(f"{name}graphs to operators", distance(recorded, plain), 2e-2))
        results.append(check(f"{name}GPU to CPU", distance(plain, learned(kind, "cpu")), 5e-2))
    return results


def rate(take: Callable[[int], None], updates: int = 16) -> float:
    """Updates per second over a few seconds."""
    took_s = 0.0
    while took_s < SECONDS_A_ROUND / 4:
        updates *= 2
        began_s = perf_counter()
        take(updates)
        torch.cuda.synchronize()
        took_s = perf_counter() - began_s
    return updates / took_s


def ours(kind: NetworkKind, device: str, *, recorded: bool = False) -> Callable[[int], None]:
    """Takes so many steps."""
    network = network_of(kind, device)
    optimizer = make_optimizer(network, 1e-3)
    pixels, actions, y = data(device)
    observations = pixels.permute(0, 3, 1, 2)
    gradients = minibatch_gradients("native", network, observations, actions, y)
    step: Step = plain_step(gradients, network, optimizer)
    if recorded:
        recordable(optimizer).__enter__()  # until the end of the program
        step = RecordedStep(step, CudaGraphs())
    order = torch.from_numpy(np.random.default_rng(0).permutation(TRANSITIONS)).to(device)
    batches = torch.split(order[: TRANSITIONS // BATCH * BATCH], BATCH)

    def take(updates: int) -> None:
        for index in range(updates):
            step(batches[index % len(batches)])

    return take


def measure() -> None:
    """All candidates take turns in each round; medians."""
    torch.set_num_threads(1)
    candidates = {}
    for kind in KINDS:
        candidates[f"{kind}, CPU, kernel, one thread"] = ours(kind, "cpu")
        candidates[f"{kind}, GPU, operator by operator"] = ours(kind, "cuda")
        candidates[f"{kind}, GPU, graphs"] = ours(kind, "cuda", recorded=True)
    candidates["Stable-Baselines3 DQN, GPU"] = stable_baselines3_updates(
        SPEC, TRANSITIONS, BATCH, "cuda"
    )
    rounds = [{name: rate(take) for name, take in candidates.items()} for _ in range(ROUNDS)]
    for name in candidates:
        print(
            f"{statistics.median(each[name] for each in rounds):8.0f} updates/s  {name}", flush=True
        )


def main() -> int:
    """Checks, then measures."""
    print(
        f"{torch.cuda.get_device_name()}, torch {torch.__version__}, {SPEC}, B = {BATCH}",
        flush=True,
    )
    allowed = torch.backends.cudnn.allow_tf32
    torch.backends.cudnn.allow_tf32 = False  # it rounds gradients to 10 bits
    results = checks()
    torch.backends.cudnn.allow_tf32 = allowed
    measure()
    return 0 if all(results) else 1


if __name__ == "__main__":
    sys.exit(main())
