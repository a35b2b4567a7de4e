"""A build that keeps what a frame is to the next one: of two stacked frames only the newer one is sent."""

from collections.abc import Iterator

import numpy as np
import pytest

from bpn.testing.kernel import assert_exact, make_image
from bpn_edge.fpga import packing, registers
from bpn_edge.fpga.build import Build
from bpn_edge.fpga.device import Device
from bpn_edge.fpga.simulated import SimulatedCore
from bpn_edge.kernel.device_bank import DeviceBank
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bnn.golden import Observation
from bpn_shared.spec.network import NetworkSpec

BUILD = Build(keeps_frame=True)
SPEC = NetworkSpec(2, 20, 3)


@pytest.fixture
def core() -> Iterator[SimulatedCore]:
    core = SimulatedCore(BUILD, seed=2)
    yield core
    core.close()


def frames(rng: np.random.Generator, count: int, spec: NetworkSpec = SPEC) -> list[Observation]:
    _, rows, columns = spec.observation_shape
    return [
        rng.integers(0, 256, (spec.channels // 2, rows, columns), dtype=np.uint8)
        for _ in range(count)
    ]


def sent(
    core: SimulatedCore, device: Device, bank: int, blob: WeightBlob, *two: Observation
) -> int:
    """Runs two frames, which is exact, and says how many were sent, by the clocks that it took."""
    begun = core.clocks
    observation = np.concatenate(two)
    found = device.run(bank, blob.spec, observation)
    assert found.tolist() == golden.forward(blob, observation)[-1].tolist()
    return round((core.clocks - begun) / (84 * 21 * BUILD.beats(blob.spec.channels)))


def test_only_the_newer_frame_is_sent_while_one_follows_the_other(core: SimulatedCore) -> None:
    rng = np.random.default_rng(0)
    device = Device(core)
    one, other = (WeightBlob.random(SPEC, rng) for _ in range(2))
    a, b, c, d, e = frames(rng, 5)
    device.load(0, one)
    device.load(1, other)
    assert sent(core, device, 0, one, a, b) == 2
    assert sent(core, device, 0, one, b, c) == 1
    assert sent(core, device, 0, one, c, d) == 1
    assert sent(core, device, 0, one, b, c) == 2  # another episode
    assert sent(core, device, 0, one, c, c) == 1
    assert sent(core, device, 1, other, c, d) == 2  # other weights: sums of before are not theirs
    assert sent(core, device, 1, other, d, e) == 1
    assert sent(core, device, 0, one, d, e) == 2
    device.load(0, other)
    assert sent(core, device, 0, other, e, a) == 2


@pytest.mark.parametrize("spec", [NetworkSpec(6, 33, 17), NetworkSpec(16, 256, 64)], ids=str)
def test_every_layer_is_exact(core: SimulatedCore, spec: NetworkSpec) -> None:
    rng = np.random.default_rng(spec.channels)
    kernel = DeviceBank("rtl", Device(core))
    for image in ("random", "zeros", "full", "black and white"):
        assert_exact(kernel, WeightBlob.random(spec, rng), make_image(image, spec, rng))
    a, b, c = frames(rng, 3, spec)
    blob = WeightBlob.random(spec, rng)
    for two in ((a, b), (b, c)):
        assert_exact(kernel, blob, np.concatenate(two))


def test_networks_that_are_sent_whole_are_as_ever(core: SimulatedCore) -> None:
    rng = np.random.default_rng(5)
    kernel = DeviceBank("rtl", Device(core))
    for spec in (NetworkSpec(1, 16, 2), SPEC, NetworkSpec(5, 7, 5), SPEC):
        assert_exact(kernel, WeightBlob.random(spec, rng), make_image("random", spec, rng))


def test_a_frame_without_one_before_has_no_result(core: SimulatedCore) -> None:
    """After selecting, after a frame of another length, after a reset."""
    rng = np.random.default_rng(1)
    blob = WeightBlob.random(SPEC, rng)
    frame = packing.beats(BUILD, frames(rng, 1)[0])
    Device(core).load(0, blob)
    for change in range(3):
        core.write(registers.SELECT, 1)
        for expected in (0, 1, 1):
            before = core.read(registers.FRAMES)
            core.send_frame(frame)
            core.run(3000)
            assert core.read(registers.FRAMES) - before == expected
        if change == 0:
            core.send_frame(frame[:500])
            core.run(3000)
            before = core.read(registers.FRAMES)
            for expected in (0, 1):
                core.send_frame(frame)
                core.run(3000)
                assert core.read(registers.FRAMES) - before == expected
        if change == 1:
            core.reset()
            Device(core).load(0, blob)


def test_selecting_while_a_frame_comes_counts_for_the_next(core: SimulatedCore) -> None:
    """What the frame in flight keeps is of the weights before."""
    rng = np.random.default_rng(3)
    one, other = (WeightBlob.random(SPEC, rng) for _ in range(2))
    device = Device(core)
    device.load(0, one)
    device.load(1, other)
    pictures = frames(rng, 3)
    core.write(registers.SELECT, 1)
    core.send_frame(packing.beats(BUILD, pictures[0]))
    core.run(500)
    core.write(registers.SELECT, 2)
    for picture in pictures[1:]:
        core.send_frame(packing.beats(BUILD, picture))
    core.run(9000)
    assert core.read(registers.FRAMES) == 1
    outputs = [core.read(registers.OUTPUTS + 4 * i) for i in range(SPEC.actions)]
    expected = golden.forward(other, np.concatenate(pictures[1:]))[-1]
    assert np.array(outputs, np.uint32).view(np.int32).tolist() == expected.tolist()


def test_a_core_that_keeps_no_frame_refuses_a_stacked_set() -> None:
    core = SimulatedCore(Build())
    words = packing.weight_set(
        BUILD, WeightBlob.random(SPEC, np.random.default_rng(0)), bank=0, epoch=1
    )
    core.send_set(words)
    core.run(3000)
    assert core.read(registers.EVENTS) == 1 << 4
    core.close()
