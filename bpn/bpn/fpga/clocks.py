"""How many clocks an inference and a reload take: by formula, and measured in simulation."""

from dataclasses import dataclass

import numpy as np

from bpn_edge.fpga import packing, registers
from bpn_edge.fpga.build import Build, groups
from bpn_edge.fpga.device import RESULT, Device
from bpn_edge.fpga.simulated import SimulatedCore
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.spec.network import NetworkSpec

_SHORTEST_JOB = 4
"""Clocks that the engine's scheduler needs from job to job."""


def by_layer(build: Build, spec: NetworkSpec) -> dict[str, int]:
    """Clocks that each layer keeps its part of the core busy; conv1's are the pixels' own."""
    node_groups, action_groups = groups(spec.hidden_units), groups(spec.actions)
    _, conv2, conv3, _, _ = spec.layers
    job = max(node_groups, _SHORTEST_JOB)
    return {
        "conv1": 84 * 21 * build.beats(spec.channels),
        "conv2": conv2.out_size**2 * (1 + conv2.fan_in // 16),
        "conv3": conv3.out_size**2 * (1 + conv3.fan_in // 16),
        "fc1": 50 * job,
        "fc2": action_groups * job,
    }


@dataclass(frozen=True)
class Measured:
    """Of one network on one build, in simulation.

    Attributes:
        frame: clocks from the first pixels to the outputs.
        tail: from the last pixels to them.
        interval: from result to result, frames following each other.
        load: for a whole weight set.
    """

    frame: int
    tail: int
    interval: float
    load: int


def measure(build: Build, spec: NetworkSpec, frames: int = 4) -> Measured:
    """Runs a random policy, and checks its outputs against the golden model.

    Raises:
        ConfigError: there is no simulator.
        AssertionError: an output is wrong.
    """
    core = SimulatedCore(build)
    device = Device(core)
    blob, image = WeightBlob.random(spec, np.random.default_rng(0)), spec.probe()
    device.load(0, blob)
    outputs = device.run(0, spec, image)
    assert np.array_equal(outputs, golden.forward(blob, image)[-1]), (
        f"{build} computes {spec} wrongly"
    )
    frame, tail = device.clocks()
    newest = np.split(image, build.frames(spec.channels))[-1]
    interval = _interval(core, packing.beats(build, newest), frames)
    words = packing.weight_set(build, blob, bank=1, epoch=2)
    begun = core.clocks
    core.send_set(words)
    while core.unsent()[1]:
        core.run(1)
    return Measured(frame, tail, interval, core.clocks - begun)


def _interval(core: SimulatedCore, beats: packing.Bits, frames: int) -> float:
    """Clocks from result to result, of frames that follow each other."""
    core.write(registers.EVENTS, RESULT)
    core.write(registers.INTERRUPT, RESULT)
    for _ in range(frames + 1):
        core.send_frame(beats)
    at = []
    for _ in range(frames + 1):
        core.wait_event(1.0)
        at.append(core.clocks)
        core.write(registers.EVENTS, RESULT)
    return (at[-1] - at[0]) / frames
