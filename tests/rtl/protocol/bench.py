"""A core whose every bus has a driver of its own, with gaps and delays at random, and a watcher of the rules."""

import random
from collections.abc import Iterable
from typing import Any

import cocotb
import numpy as np
from cocotb.clock import Clock
from cocotb.task import Task
from cocotb.triggers import Combine, RisingEdge, with_timeout

from bpn_edge.fpga import packing, registers
from bpn_edge.fpga.build import Build
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bnn.golden import Observation

OKAY, SLVERR = 0, 2
LONGEST_US = 2_000
"""Of simulated time, at 100 MHz: whoever waits longer is stuck."""


class Channel:
    """The side of a channel that offers: what is offered stays as it is until it is taken."""

    def __init__(self, dut: Any, prefix: str, payload: tuple[str, ...], rng: random.Random) -> None:
        self._dut, self._rng = dut, rng
        self._valid = getattr(dut, f"{prefix}valid")
        self._ready = getattr(dut, f"{prefix}ready")
        self._payload = {name: getattr(dut, f"{prefix}{name}") for name in payload}
        self.gaps = 0.0
        """Share of clocks in which nothing is offered."""
        self.taken = 0

    async def send(self, **values: int) -> None:
        while self._rng.random() < self.gaps:
            await RisingEdge(self._dut.aclk)
        for name, value in values.items():
            self._payload[name].value = value
        self._valid.value = 1
        while True:
            await RisingEdge(self._dut.aclk)
            if self._ready.value:
                break
        self._valid.value = 0
        self.taken += 1

    async def send_all(self, words: Iterable[int], *, last: bool = True) -> None:
        """A whole packet of a stream."""
        words = list(words)
        for number, word in enumerate(words):
            await self.send(tdata=word, tlast=int(last and number == len(words) - 1))

    def be_silent(self) -> None:
        self._valid.value = 0


class Answers:
    """The side of a channel that takes."""

    def __init__(self, dut: Any, prefix: str, payload: tuple[str, ...], rng: random.Random) -> None:
        self._dut, self._rng = dut, rng
        self._valid = getattr(dut, f"{prefix}valid")
        self._ready = getattr(dut, f"{prefix}ready")
        self._payload = [getattr(dut, f"{prefix}{name}") for name in payload]
        self.delays = 0.0
        self.taken = 0
        self._ready.value = 0

    async def take(self) -> list[int]:
        while True:
            ready = self._rng.random() >= self.delays
            self._ready.value = int(ready)
            await RisingEdge(self._dut.aclk)
            if ready and self._valid.value:
                self._ready.value = 0
                self.taken += 1
                return [int(signal.value) for signal in self._payload]

    async def watch(self) -> None:
        """An answer stays as it is until it is taken; there is none in reset's first clock."""
        before: list[int] | None = None
        while True:
            await RisingEdge(self._dut.aclk)
            if not self._dut.aresetn.value:
                before = None
                continue
            valid = bool(self._valid.value)
            now = [int(signal.value) for signal in self._payload]
            if before is not None:
                assert valid, "an answer went away before it was taken"
                assert now == before, "an answer changed before it was taken"
            before = now if valid and not self._ready.value else None


class Bench:
    """Everything that a test drives.

    Args:
        dut: the core.
        seed: of all that is random.
        gaps: share of clocks in which a master does nothing, on every channel.
    """

    def __init__(self, dut: Any, *, seed: int = 0, gaps: float = 0.0) -> None:
        self.dut, self.rng = dut, random.Random(seed)
        self.build = Build()
        self.pixels = Channel(dut, "s_axis_pixels_t", (), self.rng)
        self.weights = Channel(dut, "s_axis_weights_t", (), self.rng)
        for channel, name in ((self.pixels, "pixels"), (self.weights, "weights")):
            channel._payload = {
                field: getattr(dut, f"s_axis_{name}_{field}") for field in ("tdata", "tlast")
            }
        self.write_address = Channel(dut, "s_axi_aw", ("addr",), self.rng)
        self.write_data = Channel(dut, "s_axi_w", ("data", "strb"), self.rng)
        self.read_address = Channel(dut, "s_axi_ar", ("addr",), self.rng)
        self.written = Answers(dut, "s_axi_b", ("resp",), self.rng)
        self.read_data = Answers(dut, "s_axi_r", ("data", "resp"), self.rng)
        self.channels = (
            self.pixels, self.weights, self.write_address, self.write_data, self.read_address
        )  # fmt: skip
        self.dawdle(gaps)
        self._tasks: list[Task[None]] = []

    def dawdle(self, gaps: float) -> None:
        for channel in self.channels:
            channel.gaps = gaps
        for answers in (self.written, self.read_data):
            answers.delays = gaps

    async def begin(self) -> None:
        """The clock runs, and the core has been reset."""
        cocotb.start_soon(Clock(self.dut.aclk, 10, "ns").start())
        for answers in (self.written, self.read_data):
            cocotb.start_soon(answers.watch())
        await self.reset()

    async def reset(self, clocks: int = 2) -> None:
        """In the middle of whatever is going on: who drives a channel stops, as a reset of masters does."""
        for task in self._tasks:
            task.cancel()
        self._tasks = []
        self.dut.aresetn.value = 0
        for channel in self.channels:
            channel.be_silent()
        for answers in (self.written, self.read_data):
            answers._ready.value = 0
        await self.clocks(clocks)
        assert not self.dut.s_axi_bvalid.value, "an answer to a write outlives a reset"
        assert not self.dut.s_axi_rvalid.value, "an answer to a read outlives a reset"
        assert not self.dut.irq.value, "an interrupt outlives a reset"
        self.dut.aresetn.value = 1

    async def clocks(self, count: int) -> None:
        for _ in range(count):
            await RisingEdge(self.dut.aclk)

    def beside(self, work: Any) -> Task[None]:
        """Begins what goes on beside the test, until a reset."""
        task = cocotb.start_soon(work)
        self._tasks.append(task)
        return task

    async def write(self, register: int, value: int, *, strobes: int = 0xF) -> int:
        """Address and data each with their own gaps, so that either may come first; the answer."""
        parts = [
            self.beside(self.write_address.send(addr=register)),
            self.beside(self.write_data.send(data=value, strb=strobes)),
        ]
        answer = self.beside(self.written.take())
        await with_timeout(Combine(*parts), LONGEST_US, "us")
        return (await with_timeout(answer, LONGEST_US, "us"))[0]

    async def read(self, register: int) -> int:
        """What a register says, which is not refused."""
        value, answer = await self.ask(register)
        assert answer == OKAY, f"reading 0x{register:x} is refused"
        return value

    async def ask(self, register: int) -> tuple[int, int]:
        """What is read, and the answer."""
        self.beside(self.read_address.send(addr=register))
        answer = self.beside(self.read_data.take())
        value, response = await with_timeout(answer, LONGEST_US, "us")
        return value, response

    async def wait_for(self, register: int, bits: int) -> int:
        """Until one of the bits is set."""
        for _ in range(5_000):
            value = await self.read(register)
            if value & bits:
                return value
        raise AssertionError(f"register 0x{register:x} never has one of 0x{bits:x}")

    def set_of(self, blob: WeightBlob, bank: int, epoch: int) -> list[int]:
        return packing.weight_set(self.build, blob, bank=bank, epoch=epoch).tolist()

    def beats_of(self, image: Observation) -> list[int]:
        return packing.beats(self.build, image).view("<u4").reshape(-1).tolist()

    async def load(self, blob: WeightBlob, bank: int, epoch: int) -> None:
        """A set by its stream, until it is verified."""
        assert await self.write(registers.EVENTS, 0x7F) == OKAY
        await self.weights.send_all(self.set_of(blob, bank, epoch))
        assert await self.wait_for(registers.EVENTS, 0x7E) & 0x7E == 2, "the set is refused"

    async def expect(self, blob: WeightBlob, image: Observation, epoch: int) -> None:
        """The newest result is this policy's, of this picture."""
        assert await self.read(registers.RESULT_EPOCH) == epoch
        found = [
            await self.read(registers.OUTPUTS + 4 * action) for action in range(blob.spec.actions)
        ]
        expected = golden.forward(blob, image)[-1]
        assert np.array(found, np.uint32).view(np.int32).tolist() == expected.tolist()
