"""Weights that are replaced, and read, while frames run without a gap."""

import numpy as np
import pytest

from bpn_edge.fpga import packing, registers
from bpn_edge.fpga.device import CONV1, ENGINE, THRESHOLDS, Device
from bpn_edge.fpga.simulated import SimulatedCore
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.spec.network import NetworkSpec
from tests.rtl.core_stream import VERIFIED, CoreStream

SPEC = NetworkSpec(1, 20, 3)


@pytest.mark.timeout(3600)
def test_every_answer_belongs_wholly_to_one_policy(core: SimulatedCore, scale: int) -> None:
    """Swapped at random clock offsets; 1,000 times in `make test-rtl`."""
    rng = np.random.default_rng(scale)
    images = [rng.integers(0, 256, SPEC.observation_shape, dtype=np.uint8) for _ in range(3)]
    stream = CoreStream(core, images)
    swaps = 40 * scale
    for swap in range(swaps):
        spec = (
            SPEC if swap % 5 else NetworkSpec(1, int(rng.integers(1, 60)), int(rng.integers(2, 20)))
        )
        core.write(registers.EVENTS, VERIFIED)
        stream.load(swap % 2, WeightBlob.random(spec, rng))
        while not stream.verified():
            stream.run(int(rng.integers(1, 400)))
        core.write(registers.SELECT, 1 << swap % 2)
        stream.run(int(rng.integers(1, 2500)))
    stream.run(6000)
    stream.check()
    assert len(stream.blobs) == swaps
    assert len(stream.answers) > swaps / 2


def test_a_load_takes_no_clock_from_the_frames(core: SimulatedCore) -> None:
    rng = np.random.default_rng(0)
    spec = NetworkSpec(6, 100, 17)
    stream = CoreStream(core, [rng.integers(0, 256, spec.observation_shape, dtype=np.uint8)])
    stream.load(0, WeightBlob.random(spec, rng))
    while not stream.verified():
        stream.run(100)
    core.write(registers.SELECT, 1)
    stream.run(40_000)
    begun = core.clocks
    first = len(stream.answers)
    core.write(registers.EVENTS, VERIFIED)
    stream.load(1, WeightBlob.random(spec, rng))
    while not stream.verified():
        stream.run(100)
    assert core.clocks - begun < 5_000  # 50 us at 100 MHz
    stream.run(5 * 10_584)
    frames = len(stream.answers) - first
    assert (core.clocks - begun) / frames < 1.02 * 10_584 + 10_584 / frames
    stream.check()


def test_a_bank_that_a_frame_still_needs_is_not_overwritten(core: SimulatedCore) -> None:
    """The set waits until the frame's result is out."""
    rng = np.random.default_rng(1)
    stream = CoreStream(core, [rng.integers(0, 256, SPEC.observation_shape, dtype=np.uint8)])
    for bank in (0, 1):
        core.write(registers.EVENTS, VERIFIED)
        stream.load(bank, WeightBlob.random(SPEC, rng))
        while not stream.verified():
            core.run(50)
    for turn in range(12):
        bank = turn % 2
        core.write(registers.SELECT, 1 << bank)
        stream.run(1764 + 150 * turn)
        core.write(registers.SELECT, 2 >> bank)
        core.write(registers.EVENTS, VERIFIED)
        stream.load(bank, WeightBlob.random(SPEC, rng))
        while not stream.verified():
            stream.run(20)
    stream.run(6000)
    stream.check()


def test_what_is_read_while_frames_run_is_right_and_so_are_the_frames(core: SimulatedCore) -> None:
    """Each read waits for a clock that the frames leave free."""
    rng = np.random.default_rng(2)
    images = [rng.integers(0, 256, SPEC.observation_shape, dtype=np.uint8) for _ in range(3)]
    stream = CoreStream(core, images)
    blob = WeightBlob.random(SPEC, rng)
    stream.load(0, blob)
    while not stream.verified():
        stream.run(100)
    core.write(registers.SELECT, 1)
    conv1, thresholds, engine = packing.memories(core.build, blob)
    row = core.build.conv1_lanes << core.build.beat_bits
    parts = [(CONV1, at * row, words) for at, words in enumerate(np.split(conv1, 4))]
    for region, begin, words in (*parts, (THRESHOLDS, 0, thresholds), (ENGINE, 0, engine)):
        for at in range(0, len(words), 16):
            expected = words[at : at + 16].tolist()
            core.write(registers.READ_ADDRESS, region << 28 | begin + at)
            assert [core.read(registers.READ_DATA) for _ in expected] == expected
            stream.run(int(rng.integers(1, 300)))
    stream.run(6000)
    stream.check()
    assert len(stream.answers) > 10


@pytest.mark.parametrize("bank", [0, 1])
def test_a_bank_that_the_newest_of_two_frames_needs_is_not_overwritten(
    core: SimulatedCore, bank: int
) -> None:
    """While one frame is in the engine and the next one has begun."""
    rng = np.random.default_rng(4)
    image = rng.integers(0, 256, SPEC.observation_shape, dtype=np.uint8)
    blob, other, third = (WeightBlob.random(SPEC, rng) for _ in range(3))
    device = Device(core)
    device.load(bank, blob)
    device.load(1 - bank, other)
    epoch = core.read(registers.BANK_EPOCH + 4 * bank)
    core.write(registers.SELECT, 1 << bank)
    beats = packing.beats(core.build, image)
    for _ in range(2):
        core.send_frame(beats)
    while core.unsent()[0] > len(beats) - 8:
        core.run(1)
    core.write(registers.SELECT, 2 >> bank)
    core.send_set(packing.weight_set(core.build, third, bank=bank, epoch=99))
    core.run(6000)
    assert core.read(registers.FRAMES) == 2
    assert core.read(registers.RESULT_EPOCH) == epoch
    found = [core.read(registers.OUTPUTS + 4 * i) for i in range(SPEC.actions)]
    expected = golden.forward(blob, image)[-1]
    assert np.array(found, np.uint32).view(np.int32).tolist() == expected.tolist()
    assert core.read(registers.BANK_EPOCH + 4 * bank) == 99


def test_a_bank_says_what_is_in_it(core: SimulatedCore) -> None:
    rng = np.random.default_rng(6)
    specs = NetworkSpec(3, 77, 19), NetworkSpec(5, 130, 64)
    sets = [
        packing.weight_set(core.build, WeightBlob.random(spec, rng), bank=bank, epoch=11 + bank)
        for bank, spec in enumerate(specs)
    ]
    for words in sets:
        core.send_set(words)
        core.run(10_000)
    for bank, spec in enumerate(specs):
        assert core.read(registers.BANK_EPOCH + 4 * bank) == 11 + bank
        assert core.read(registers.BANK_CRC + 4 * bank) == sets[bank][-1]
        sizes = spec.channels | spec.actions << 8 | spec.hidden_units << 16
        assert core.read(registers.BANK_SIZES + 4 * bank) == sizes
