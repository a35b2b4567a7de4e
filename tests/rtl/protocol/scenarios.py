"""What is tried on the core's buses; each scenario is a test of cocotb, run by tests/rtl/test_protocol.py."""

from typing import Any

import cocotb
import numpy as np

from bpn_edge.fpga import registers
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.spec.network import NetworkSpec
from tests.rtl.protocol.bench import OKAY, SLVERR, Bench

SPEC = NetworkSpec(1, 5, 3)
ONE, OTHER = (WeightBlob.random(SPEC, np.random.default_rng(seed)) for seed in (1, 2))
IMAGE = np.random.default_rng(3).integers(0, 256, SPEC.observation_shape, dtype=np.uint8)
RESULT = 1
LIMIT = {"timeout_time": 5, "timeout_unit": "ms"}
"""Of simulated time: several times what the longest scenario takes."""


@cocotb.test(**LIMIT)
async def every_access_is_answered_once(dut: Any) -> None:
    """Writes and reads beside each other, address and data in any order, answers taken late."""
    bench = Bench(dut, seed=1, gaps=0.5)
    await bench.begin()
    last = 0

    async def reads() -> None:
        for _ in range(60):
            assert await bench.read(registers.IDENTITY) == 0x42500001
            _, answer = await bench.ask(0x3F0)
            assert answer == SLVERR

    beside = bench.beside(reads())
    for _ in range(120):
        value = bench.rng.randrange(128)
        strobes = 0xF if bench.rng.random() < 0.7 else bench.rng.randrange(15)
        answer = await bench.write(registers.INTERRUPT, value, strobes=strobes)
        assert answer == (OKAY if strobes == 0xF else SLVERR)
        last = value if answer == OKAY else last
        assert await bench.write(registers.IDENTITY, value) == SLVERR
    await beside
    assert await bench.read(registers.INTERRUPT) == last
    await bench.clocks(20)
    assert bench.written.taken == bench.write_address.taken == bench.write_data.taken == 240
    assert bench.read_data.taken == bench.read_address.taken
    assert not dut.s_axi_bvalid.value
    assert not dut.s_axi_rvalid.value


@cocotb.test(**LIMIT)
async def a_write_waits_for_both_of_its_parts(dut: Any) -> None:
    """Address long before data, data long before address, and the next write's parts before this one's answer."""
    bench = Bench(dut)
    await bench.begin()
    for first, second in ((0, 1), (1, 0)):
        parts = [
            lambda: bench.write_address.send(addr=registers.INTERRUPT),
            lambda: bench.write_data.send(data=0x55, strb=0xF),
        ]
        await parts[first]()
        bench.beside(parts[first]())  # of the next one: has to wait
        await bench.clocks(30)
        assert not dut.s_axi_bvalid.value
        await parts[second]()
        assert await bench.written.take() == [OKAY]
        await parts[second]()
        assert await bench.written.take() == [OKAY]
    assert await bench.read(registers.INTERRUPT) == 0x55


@cocotb.test(**LIMIT)
async def gaps_and_back_pressure_change_nothing(dut: Any) -> None:
    """Sets and frames with gaps, while registers are asked: the same outputs, and both streams to their end."""
    for seed, gaps in enumerate((0.0, 0.3, 0.8)):
        bench = Bench(dut, seed=seed, gaps=gaps)
        await bench.begin()
        await bench.load(ONE, 0, epoch=7)
        assert await bench.write(registers.SELECT, 1) == OKAY
        bench.dawdle(gaps / 2)
        frame = bench.beside(bench.pixels.send_all(bench.beats_of(IMAGE)))
        other = bench.beside(bench.weights.send_all(bench.set_of(OTHER, 1, 8)))
        await bench.wait_for(registers.EVENTS, RESULT)
        await bench.expect(ONE, IMAGE, 7)
        await frame
        await other
        assert await bench.wait_for(registers.EVENTS, 0x7C | 2)
        assert await bench.read(registers.FRAMES) == 1


@cocotb.test(**LIMIT)
async def a_stream_is_not_taken_where_nothing_may_be(dut: Any) -> None:
    """No bank is selected: pixels wait, whatever is offered, and none is lost once one is."""
    bench = Bench(dut)
    await bench.begin()
    frame = bench.beside(bench.pixels.send_all(bench.beats_of(IMAGE)))
    await bench.clocks(200)
    assert bench.pixels.taken == 0
    await bench.load(ONE, 1, epoch=3)
    await bench.clocks(200)
    assert bench.pixels.taken == 0
    assert await bench.write(registers.SELECT, 2) == OKAY
    await bench.wait_for(registers.EVENTS, RESULT)
    await frame
    await bench.expect(ONE, IMAGE, 3)


@cocotb.test(**LIMIT)
async def writes_while_busy_are_refused_or_wait(dut: Any) -> None:
    """While a set is half there: its bank is not to be had, its memories neither; the frame beside it is right."""
    bench = Bench(dut, seed=4)
    await bench.begin()
    await bench.load(ONE, 0, epoch=1)
    assert await bench.write(registers.SELECT, 1) == OKAY
    words = bench.set_of(OTHER, 1, 2)
    await bench.weights.send_all(words[:100], last=False)
    frame = bench.beside(bench.pixels.send_all(bench.beats_of(IMAGE)))
    for _ in range(40):
        assert await bench.write(registers.SELECT, bench.rng.choice((2, 3))) == SLVERR
        assert (await bench.ask(registers.READ_DATA))[1] == SLVERR
        assert await bench.write(registers.OUTPUTS, 1) == SLVERR
        assert await bench.read(registers.SELECT) == 1
    await bench.wait_for(registers.EVENTS, RESULT)
    await frame
    await bench.expect(ONE, IMAGE, 1)
    await bench.weights.send_all(words[100:])
    await bench.wait_for(registers.STATUS, 2)
    assert await bench.write(registers.SELECT, 2) == OKAY


@cocotb.test(**LIMIT)
async def pushed_words_are_refused_while_there_is_no_room(dut: Any) -> None:
    """A set pushed by registers into a loader that waits for a frame: every refused word is pushed again."""
    bench = Bench(dut, seed=5)
    await bench.begin()
    await bench.load(ONE, 0, epoch=1)
    assert await bench.write(registers.SELECT, 1) == OKAY
    beats = bench.beats_of(IMAGE)
    await bench.pixels.send_all(beats[:900], last=False)
    assert await bench.write(registers.SELECT, 0) == OKAY
    words = bench.set_of(OTHER, 0, 9)  # bank 0, which the frame still has
    pushed = 0
    while await bench.write(registers.WEIGHTS, words[pushed]) == OKAY:
        pushed += 1
    assert pushed == 4  # identity, sizes, epoch, and one that waits in front
    assert await bench.write(registers.WEIGHTS, words[pushed]) == SLVERR
    assert await bench.read(registers.STATUS) & 1 == 0
    await bench.pixels.send_all(beats[900:])
    await bench.wait_for(registers.EVENTS, RESULT)
    await bench.expect(ONE, IMAGE, 1)
    for word in words[pushed:-1]:
        while await bench.write(registers.WEIGHTS, word) != OKAY:
            pass
    assert await bench.write(registers.WEIGHTS_LAST, words[-1]) == OKAY
    await bench.wait_for(registers.STATUS, 1)


@cocotb.test(**LIMIT)
async def events_are_not_lost_and_the_interrupt_follows_them(dut: Any) -> None:
    """Frames without a gap, events cleared all the time: as many results are seen as there are."""
    bench = Bench(dut, seed=6)
    await bench.begin()
    await bench.load(ONE, 0, epoch=1)
    assert await bench.write(registers.EVENTS, 0x7F) == OKAY
    assert await bench.write(registers.SELECT, 1) == OKAY
    assert await bench.write(registers.INTERRUPT, RESULT) == OKAY
    frames = 3

    async def send() -> None:
        for _ in range(frames):
            await bench.pixels.send_all(bench.beats_of(IMAGE))

    beside = bench.beside(send())
    seen = 0
    for _ in range(20_000):
        if dut.irq.value:
            seen += 1
            assert await bench.write(registers.EVENTS, RESULT) == OKAY
            await bench.clocks(2)
            assert not dut.irq.value
        elif seen == frames:
            break
        assert await bench.write(registers.EVENTS, 0x7E) == OKAY
    await beside
    assert seen == frames == await bench.read(registers.FRAMES)


@cocotb.test(**LIMIT)
async def a_reset_in_the_middle_of_everything(dut: Any) -> None:
    """Of loads, frames, writes and reads at once; afterwards the core holds nothing, and works."""
    bench = Bench(dut, seed=7, gaps=0.2)
    await bench.begin()

    async def accesses() -> None:
        while True:
            await bench.write(registers.SELECT, bench.rng.randrange(4))
            await bench.ask(bench.rng.choice((registers.READ_DATA, registers.STATUS)))

    for turn in range(12):
        if turn % 2:
            await bench.load(ONE, turn % 4 // 2, epoch=turn)
            await bench.write(registers.SELECT, 1 << turn % 4 // 2)
        bench.beside(bench.pixels.send_all(bench.beats_of(IMAGE)))
        bench.beside(bench.weights.send_all(bench.set_of(OTHER, turn % 3 % 2, 9)))
        bench.beside(accesses())
        await bench.clocks(bench.rng.randrange(1, 1500))
        await bench.reset(bench.rng.randrange(1, 4))
        for register in (registers.STATUS, registers.EVENTS, registers.FRAMES, registers.SELECT):
            assert await bench.read(register) == 0
    bench.dawdle(0)
    await bench.load(OTHER, 1, epoch=5)
    assert await bench.write(registers.SELECT, 2) == OKAY
    bench.beside(bench.pixels.send_all(bench.beats_of(IMAGE)))
    await bench.wait_for(registers.EVENTS, RESULT)
    await bench.expect(OTHER, IMAGE, 5)
