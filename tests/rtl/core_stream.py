"""Frames that follow each other without a gap through a simulated core, and what came out of each."""

from dataclasses import dataclass

import numpy as np

from bpn_edge.fpga import packing, registers
from bpn_edge.fpga.simulated import SimulatedCore
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bnn.golden import Observation

RESULT, VERIFIED = 1 << 0, 1 << 1


@dataclass
class Answer:
    frame: int
    epoch: int
    outputs: list[int]


class CoreStream:
    """Keeps the core's stream of pixels full, and notes every result."""

    def __init__(self, core: SimulatedCore, images: list[Observation]) -> None:
        self.core = core
        self.images = images
        self.sent = 0
        self.answers: list[Answer] = []
        self.blobs: dict[int, WeightBlob] = {}
        core.write(registers.INTERRUPT, RESULT)

    def load(self, bank: int, blob: WeightBlob) -> None:
        epoch = len(self.blobs) + 1
        self.blobs[epoch] = blob
        self.core.send_set(packing.weight_set(self.core.build, blob, bank=bank, epoch=epoch))

    def run(self, clocks: int) -> None:
        """Lets at least so many clocks pass."""
        end = self.core.clocks + clocks
        while self.core.clocks < end:
            while self.core.unsent()[0] < 2 * len(packing.beats(self.core.build, self.images[0])):
                image = self.images[self.sent % len(self.images)]
                self.core.send_frame(packing.beats(self.core.build, image))
                self.sent += 1
            if self.core.wait_event(min(1000, end - self.core.clocks) / 1_000_000):
                self._note()

    def verified(self) -> bool:
        return bool(self.core.read(registers.EVENTS) & VERIFIED)

    def _note(self) -> None:
        core = self.core
        core.write(registers.EVENTS, RESULT)
        frame, epoch = core.read(registers.FRAMES) - 1, core.read(registers.RESULT_EPOCH)
        actions = core.read(registers.RESULT_SIZES) >> 8 & 0x7F
        outputs = [core.read(registers.OUTPUTS + 4 * i) for i in range(actions)]
        assert core.read(registers.FRAMES) - 1 == frame
        self.answers.append(
            Answer(frame, epoch, np.array(outputs, np.uint32).view(np.int32).tolist())
        )

    def check(self) -> None:
        """Every frame was answered once, wholly by one policy, and policies follow each other."""
        assert [answer.frame for answer in self.answers] == list(range(len(self.answers)))
        epochs = [answer.epoch for answer in self.answers]
        assert epochs == sorted(epochs)
        expected: dict[tuple[int, int], list[int]] = {}
        for answer in self.answers:
            key = answer.epoch, answer.frame % len(self.images)
            if key not in expected:
                image = self.images[key[1]]
                expected[key] = golden.forward(self.blobs[key[0]], image)[-1].tolist()
            assert answer.outputs == expected[key], answer
