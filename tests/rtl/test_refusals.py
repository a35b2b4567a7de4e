"""What the core does not take, and that it goes on all the same."""

import os
from collections.abc import Callable

import numpy as np
import pytest

from bpn_edge.fpga import packing, registers, verilated
from bpn_edge.fpga.build import Build
from bpn_edge.fpga.device import Device
from bpn_edge.fpga.packing import Words
from bpn_edge.fpga.simulated import SimulatedCore
from bpn_edge.fpga.transport import DeviceError, RefusedError
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.spec.config import ConfigError
from bpn_shared.spec.network import NetworkSpec

SPEC = NetworkSpec(1, 20, 3)
ONE, OTHER = (WeightBlob.random(SPEC, np.random.default_rng(seed)) for seed in (1, 2))
IMAGE = np.random.default_rng(3).integers(0, 256, SPEC.observation_shape, dtype=np.uint8)
BEATS = packing.beats(Build(), IMAGE)
IDENTITY, SIZES, LENGTH, CRC = (1 << bit for bit in (3, 4, 5, 6))
MISALIGNED = 1 << 2


def outputs(device: Device, bank: int, blob: WeightBlob) -> None:
    np.testing.assert_array_equal(
        device.run(bank, blob.spec, IMAGE), golden.forward(blob, IMAGE)[-1]
    )


def changed(index: int, value: int) -> Callable[[Words], Words]:
    def change(words: Words) -> Words:
        words = words.copy()
        words[index] ^= np.uint32(value)
        return words

    return change


@pytest.mark.parametrize(
    ("change", "event"),
    [
        (changed(0, 1 << 8), IDENTITY),
        (changed(0, 1), IDENTITY),
        (changed(1, 1 << 7), SIZES),  # the bank that runs
        (changed(1, 31), SIZES),  # C = 30
        (changed(1, 1), SIZES),  # C = 0
        (changed(1, 1 << 5), SIZES),
        (changed(1, 1 << 15), SIZES),  # |A| = 131
        (changed(1, 2 << 8), SIZES),  # |A| = 1
        (changed(1, 1 << 29), SIZES),
        (changed(1, 16 << 16), LENGTH),  # N = 4: fewer words follow
        (changed(1, 64 << 16), LENGTH),  # N = 84: more
        (changed(2, 1), CRC),
        (changed(3, 1 << 31), CRC),
        (changed(100, 1), CRC),
        (changed(-2, 1), CRC),
        (changed(-1, 1), CRC),
        (lambda words: words[:-1], LENGTH),
        (lambda words: words[:1], LENGTH),
        (lambda words: words[:2], LENGTH),
        (lambda words: words[:300], LENGTH),
        (lambda words: np.append(words, np.uint32(0)), LENGTH),
    ],
)
def test_a_wrong_set_never_runs(
    core: SimulatedCore, change: Callable[[Words], Words], event: int
) -> None:
    device = Device(core)
    device.load(0, ONE)
    outputs(device, 0, ONE)
    device.load(1, OTHER)
    core.write(registers.EVENTS, 0x7F)
    core.send_set(change(packing.weight_set(Build(), OTHER, bank=1, epoch=9)))
    core.run(3000)
    assert core.unsent()[1] == 0
    assert core.read(registers.EVENTS) == event
    early = event in {IDENTITY, SIZES} or core.read(registers.STATUS) & 2
    if not early:
        with pytest.raises(RefusedError):
            core.write(registers.SELECT, 2)
    outputs(device, 0, ONE)
    device.load(1, OTHER)
    outputs(device, 1, OTHER)


def test_half_a_set_never_runs(core: SimulatedCore) -> None:
    device = Device(core)
    device.load(0, ONE)
    device.load(1, OTHER)
    words = packing.weight_set(Build(), OTHER, bank=1, epoch=9)
    core.send_set(words[:200], last=False)
    core.run(1000)
    for banks in (2, 3):
        with pytest.raises(RefusedError):
            core.write(registers.SELECT, banks)
    with pytest.raises(RefusedError):
        core.read(registers.READ_DATA)
    outputs(device, 0, ONE)
    core.send_set(words[200:])
    core.run(1000)
    core.write(registers.SELECT, 2)


def test_no_frame_begins_without_a_verified_bank(core: SimulatedCore) -> None:
    core.send_frame(BEATS)
    core.run(3000)
    assert core.unsent()[0] == len(BEATS)
    for banks in (1, 2, 3):
        with pytest.raises(RefusedError):
            core.write(registers.SELECT, banks)
    device = Device(core)
    device.load(0, ONE)
    core.write(registers.SELECT, 1)
    core.run(3000)
    assert core.unsent()[0] == 0
    assert core.read(registers.FRAMES) == 1


@pytest.mark.parametrize("count", [1, 2, 500, len(BEATS) - 1, len(BEATS) + 1, len(BEATS) + 700])
def test_a_frame_of_another_length_has_no_result(core: SimulatedCore, count: int) -> None:
    device = Device(core)
    device.load(0, ONE)
    outputs(device, 0, ONE)
    core.write(registers.EVENTS, 0x7F)
    core.send_frame(np.resize(BEATS, (count, 4)))
    core.run(5000)
    assert core.read(registers.EVENTS) == MISALIGNED
    assert core.read(registers.FRAMES) == 1
    outputs(device, 0, ONE)
    assert core.read(registers.FRAMES) == 2


def test_reset_in_the_middle_of_anything(core: SimulatedCore) -> None:
    """Whatever it was doing, afterwards it holds nothing, and works."""
    rng = np.random.default_rng(0)
    for turn in range(50):
        device = Device(core)
        device.load(0, ONE)
        outputs(device, 0, ONE)
        core.write(registers.SELECT, 1)
        core.send_frame(BEATS)
        core.send_frame(BEATS)
        core.run(int(rng.integers(0, 2500)))
        if turn % 2:
            core.send_set(packing.weight_set(Build(), OTHER, bank=1, epoch=9))
            core.run(int(rng.integers(0, 700)))
        core.forget_unsent()
        core.reset()
        assert core.read(registers.STATUS) == 0
        assert core.read(registers.FRAMES) == 0
        assert core.read(registers.EVENTS) == 0
    device = Device(core)
    device.load(1, OTHER)
    outputs(device, 1, OTHER)


def test_registers_refuse_what_they_are_not_made_for(core: SimulatedCore) -> None:
    for offset in range(0, 1024, 4):
        known = (
            offset in range(0x00, 0x48, 4)
            or offset in {0x50, 0x54}
            or (offset >= 0x100 and offset < 0x200)
        )
        if known:
            core.read(offset)
        else:
            with pytest.raises(RefusedError):
                core.read(offset)
    read_only = (
        registers.IDENTITY,
        registers.BUILD,
        registers.STATUS,
        registers.FRAMES,
        registers.OUTPUTS,
        0x3F0,
    )
    for register in read_only:
        with pytest.raises(RefusedError):
            core.write(register, 1)
    for strobes in (0, 1, 7, 14):
        with pytest.raises(RefusedError):
            core.write(registers.INTERRUPT, 1, strobes=strobes)
    assert core.read(registers.INTERRUPT) == 0


def test_a_pushed_word_that_finds_no_room_is_refused(core: SimulatedCore) -> None:
    core.write(registers.PIXELS, 1)  # waits for a bank
    with pytest.raises(RefusedError):
        core.write(registers.PIXELS, 2)
    core.write(registers.WEIGHTS, 1)  # which is another stream's
    with pytest.raises(RefusedError):
        core.write(registers.PIXELS_LAST, 2)


def push(core: SimulatedCore, words: Words, register: int, last_register: int) -> None:
    for word in words[:-1].tolist():
        core.write(register, word)
    core.write(last_register, int(words[-1]))


def test_sets_and_frames_are_pushed_word_by_word(core: SimulatedCore) -> None:
    """As the driver of a mapped core does; where there is no room, the refused word is pushed again."""
    pixels = BEATS.view("<u4").reshape(-1)
    one = packing.weight_set(Build(), ONE, bank=0, epoch=1)
    push(core, one, registers.WEIGHTS, registers.WEIGHTS_LAST)
    core.run(10)
    assert core.read(registers.STATUS) == 1
    core.write(registers.SELECT, 1)
    for word in pixels[:700].tolist():
        core.write(registers.PIXELS, word)
    core.write(registers.SELECT, 0)
    other = packing.weight_set(Build(), OTHER, bank=0, epoch=2).tolist()
    room = 4  # identity, sizes, an epoch that waits for the frame, and one in front
    for word in other[:room]:
        core.write(registers.WEIGHTS, word)
    for _ in range(2):
        with pytest.raises(RefusedError):
            core.write(registers.WEIGHTS, other[room])
    push(core, pixels[700:], registers.PIXELS, registers.PIXELS_LAST)
    core.run(1000)
    assert core.read(registers.FRAMES) == 1
    assert core.read(registers.RESULT_EPOCH) == 1
    found = [core.read(registers.OUTPUTS + 4 * i) for i in range(SPEC.actions)]
    expected = golden.forward(ONE, IMAGE)[-1]
    assert np.array(found, np.uint32).view(np.int32).tolist() == expected.tolist()
    push(core, np.array(other[room:]), registers.WEIGHTS, registers.WEIGHTS_LAST)
    core.run(10)
    assert core.read(registers.BANK_EPOCH) == 2


def test_a_bit_that_flips_in_the_memory_is_seen(core: SimulatedCore) -> None:
    """What is read back is what the engine computes with, not what went in."""
    device = Device(core)
    device.load(0, ONE)
    before = [words.copy() for words in device.memories(0, SPEC)]
    device.load(0, OTHER)
    after = device.memories(0, SPEC)
    assert all((a != b).any() for a, b in zip(before, after, strict=True))
    for held, packed in zip(after, packing.memories(Build(), OTHER), strict=True):
        np.testing.assert_array_equal(held, packed)


def test_a_core_that_does_not_answer_is_said_to(core: SimulatedCore) -> None:
    device = Device(core)
    device.load(0, ONE)
    core.dawdle(pixels=256)
    with pytest.raises(DeviceError, match="does not answer within 5 s"):
        device.run(0, SPEC, IMAGE)


def test_a_tool_that_does_not_end_is_given_up() -> None:
    with pytest.raises(ConfigError, match=r"cannot be made: sleep has not ended after 0.1 s"):
        verilated._run(["sleep", "60"], dict(os.environ), longest_s=0.1)
