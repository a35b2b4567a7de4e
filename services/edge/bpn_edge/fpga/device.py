"""The driver of the core: loads weight sets into its banks, sends frames, reads results; over any `Transport`."""

import threading

import numpy as np

from bpn_edge.fpga import packing, registers
from bpn_edge.fpga.build import BLOCK_PX, Build, engine_words, groups
from bpn_edge.fpga.package import IDENTITY
from bpn_edge.fpga.packing import Words
from bpn_edge.fpga.transport import DeviceError, Transport
from bpn_shared.bnn.blob import Parameters, WeightBlob
from bpn_shared.bnn.envelope import BlobError
from bpn_shared.bnn.golden import Integers, Observation, check_observation
from bpn_shared.spec.config import ConfigError
from bpn_shared.spec.network import NetworkSpec

RESULT, VERIFIED, MISALIGNED = 1 << 0, 1 << 1, 1 << 2
REFUSALS = {
    1 << 3: "it is of another layout",
    1 << 4: "its sizes do not fit the core, or its bank is running",
    1 << 5: "it has another length",
    1 << 6: "its CRC is wrong",
}
_EVENTS = 0x7F
_TIMEOUT_S = 5.0
"""A frame takes 0.1 ms, a set 0.03 ms; pushed word by word over a slow bus, a second."""
CONV1, THRESHOLDS, ENGINE, CONV1_MAP, MAPS = range(5)
"""Regions of the core's memories."""


class Device:
    """One core with its two banks. Several threads may use it; each call has it alone.

    Raises:
        ConfigError: what is there is no core, or one of another layout.
    """

    def __init__(self, transport: Transport) -> None:
        self._transport = transport
        self._lock = threading.RLock()
        identity = transport.read(registers.IDENTITY)
        if identity != IDENTITY:
            raise ConfigError(
                f"there is no core of this version: identity 0x{identity:08x}, this driver's is 0x{IDENTITY:08x}; "
                "load the bitstream that `bpn fpga build` made of the same version"
            )
        build, limits = transport.read(registers.BUILD), transport.read(registers.LIMITS)
        try:
            self.build = Build(
                build >> 24, build >> 16 & 0xFF, limits, build >> 8 & 0xFF, bool(build & 1)
            )
        except ValueError as error:
            raise ConfigError(
                f"the core says that it was built for what no core is: {error}"
            ) from error
        self._epoch = max(transport.read(registers.BANK_EPOCH + 4 * bank) for bank in (0, 1))
        self._epochs = [0, 0]
        self._sent: Observation | None = None
        """The frame that the core keeps as the earlier one of the next two."""

    def load(self, bank: int, blob: WeightBlob) -> None:
        """Loads a policy into a bank; frames of the other one go on.

        Raises:
            BlobError: the core was built for smaller networks, or refuses the set.
        """
        reason = self.build.why_not(blob.spec)
        if reason is not None:
            raise BlobError(reason)
        with self._lock:
            if self._selected() == bank:
                self._transport.write(registers.SELECT, 0)
            self._epoch = (self._epoch + 1) & 0xFFFF_FFFF
            words = packing.weight_set(self.build, blob, bank=bank, epoch=self._epoch)
            self._clear_events()
            self._transport.send_set(words)
            events = self._wait(VERIFIED | sum(REFUSALS))
            for bit, reason in REFUSALS.items():
                if events & bit:
                    raise BlobError(f"the core refused the weight set: {reason}")
            if self._transport.read(registers.BANK_CRC + 4 * bank) != words[-1]:
                raise BlobError("the core holds another weight set than it was sent")
            self._epochs[bank] = self._epoch

    def run(self, bank: int, spec: NetworkSpec, observation: Observation) -> Integers:
        """One inference with a bank's policy: o_5, int32[|A|].

        Raises:
            ValueError: the observation does not fit the network.
            DeviceError: the core gives no result, or one of another policy.
        """
        check_observation(spec, observation)
        with self._lock:
            self._clear_events()
            self._send(bank, observation)
            if self._wait(RESULT | MISALIGNED) & MISALIGNED:
                raise DeviceError("the core got a frame that was too short or too long")
            epoch = self._transport.read(registers.RESULT_EPOCH)
            if epoch != self._epochs[bank]:
                raise DeviceError(f"the result is of epoch {epoch}, not {self._epochs[bank]}")
            if self.build.frames(spec.channels) == 2:
                self._sent = observation[spec.channels // 2 :].copy()
            outputs = [self._transport.read(registers.OUTPUTS + 4 * i) for i in range(spec.actions)]
            return np.array(outputs, np.uint32).view(np.int32)

    def _send(self, bank: int, observation: Observation) -> None:
        """Frames that a core which keeps one has already got under the same weights are not sent again."""
        sent, self._sent = self._sent, None
        selected = self._selected() == bank
        frames = np.split(observation, self.build.frames(len(observation)))
        if len(frames) == 2 and selected and sent is not None and np.array_equal(frames[0], sent):
            frames = frames[1:]
        elif len(frames) == 2 or not selected:
            self._transport.write(registers.SELECT, 1 << bank)
        for frame in frames:
            self._transport.send_frame(packing.beats(self.build, frame))

    def memories(self, bank: int, spec: NetworkSpec) -> tuple[Words, Words, Words]:
        """What is in a bank's memories, as `packing.memories` has it."""
        beats = self.build.beats(spec.channels)
        lanes = self.build.conv1_lanes
        used = self.build.frames(spec.channels) * self.build.pixel_bytes
        node_groups, action_groups = groups(spec.hidden_units), groups(spec.actions)
        with self._lock:
            rows = [
                self._memory(CONV1, bank, (row << self.build.beat_bits) * lanes, beats * lanes)
                .reshape(beats, lanes)[:, :used]
                .reshape(-1)
                for row in range(BLOCK_PX)
            ]
            thresholds = self._memory(THRESHOLDS, bank, 0, spec.layers[0].out_channels)
            engine = self._memory(ENGINE, bank, 0, 8 * engine_words(node_groups, action_groups))
        return np.concatenate(rows), thresholds, engine

    def read_back(self, bank: int, spec: NetworkSpec) -> Parameters:
        """A bank's policy, from the memories that the core computes with.

        Raises:
            BlobError: they hold what no policy is stored as.
        """
        return packing.parameters(self.build, spec, self.memories(bank, spec))

    def trace(
        self, bank: int, spec: NetworkSpec, observation: Observation
    ) -> tuple[tuple[Observation, ...], Integers]:
        """One inference with the activations of layers 1-4, uint8, flattened; and o_5."""
        with self._lock:
            outputs = self.run(bank, spec, observation)
            conv1 = self._map(CONV1_MAP, 0, spec.layers[0].out_size ** 2 // 2)
            maps = (
                self._map(MAPS, 0, 81),
                self._map(MAPS, 128, 49),
                self._map(MAPS, 192, groups(spec.hidden_units))[: spec.hidden_units],
            )
        return (conv1, *maps), outputs

    def clocks(self) -> tuple[int, int]:
        """Of the newest result: clocks since its first pixels, and since its last."""
        with self._lock:
            return self._transport.read(registers.CLOCKS), self._transport.read(registers.TAIL)

    def close(self) -> None:
        """Gives the core back."""
        self._transport.close()

    def _map(self, region: int, begin: int, count: int) -> Observation:
        words = self._memory(region, 0, begin, count).astype("<u2")
        return np.unpackbits(words.view(np.uint8), bitorder="little")

    def _memory(self, region: int, bank: int, begin: int, count: int) -> Words:
        self._transport.write(registers.READ_ADDRESS, region << 28 | bank << 27 | begin)
        return np.array(
            [self._transport.read(registers.READ_DATA) for _ in range(count)], np.uint32
        )

    def _selected(self) -> int | None:
        selected = self._transport.read(registers.SELECT)
        return selected - 1 if selected else None

    def _clear_events(self) -> None:
        self._transport.write(registers.INTERRUPT, _EVENTS)
        self._transport.write(registers.EVENTS, _EVENTS)

    def _wait(self, awaited: int) -> int:
        """Those of the events that have happened, once one has."""
        self._transport.write(registers.INTERRUPT, awaited)
        if not self._transport.wait_event(_TIMEOUT_S):
            status = self._transport.read(registers.STATUS)
            raise DeviceError(
                f"the core does not answer within {_TIMEOUT_S:g} s; its status is 0x{status:x}"
            )
        return self._transport.read(registers.EVENTS) & awaited
