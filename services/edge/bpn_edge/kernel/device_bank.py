"""The kernels of the FPGA: each is one of the two banks of a core, simulated (`rtl`) or there (`fpga`)."""

import zlib

from bpn_edge.fpga.build import Build
from bpn_edge.fpga.device import Device
from bpn_edge.fpga.transport import DeviceError
from bpn_edge.kernel.protocol import Kernel, binarized, not_loaded
from bpn_shared.bnn.blob import Parameters
from bpn_shared.bnn.envelope import BlobError
from bpn_shared.bnn.golden import Integers, Observation
from bpn_shared.bnn.weights import Weights
from bpn_shared.spec.config import ConfigError
from bpn_shared.spec.network import NetworkSpec


class DeviceBank:
    """A `Kernel` that is one bank of a core, which swaps banks itself, between two frames."""

    def __init__(self, name: str, device: Device, bank: int = 0) -> None:
        self.name = name
        self._device = device
        self._bank = bank
        self._spec: NetworkSpec | None = None

    def other_bank(self) -> Kernel:
        """See `bpn_edge.kernel.banks`."""
        return DeviceBank(self.name, self._device, 1 - self._bank)

    def load(self, weights: Weights) -> None:
        """See `Kernel.load`.

        Raises:
            BlobError: also for a network that is larger than the core was built for.
        """
        blob = binarized(self.name, weights)
        self._spec = None
        try:
            self._device.load(self._bank, blob)
        except BlobError as error:
            raise BlobError(f"the {self.name} kernel: {error}") from error
        self._spec = blob.spec

    def read_back(self) -> Parameters:
        """See `Kernel.read_back`."""
        return self._device.read_back(self._bank, self._loaded())

    def checksum(self) -> int:
        """See `Kernel.checksum`; over all words of the core's memories."""
        sum_ = 0
        for words in self._device.memories(self._bank, self._loaded()):
            sum_ = zlib.crc32(words.tobytes(), sum_)
        return sum_

    def run(self, observation: Observation) -> Integers:
        """See `Kernel.run`.

        Raises:
            DeviceError: the core does not answer, or with another policy's outputs.
        """
        return self._device.run(self._bank, self._loaded(), observation)

    def trace(self, observation: Observation) -> tuple[tuple[Observation, ...], Integers]:
        """As `NativeKernel.trace`."""
        return self._device.trace(self._bank, self._loaded(), observation)

    def clocks(self) -> tuple[int, int]:
        """Of the newest inference: clocks from the first pixels to the outputs, and from the last."""
        return self._device.clocks()

    def _loaded(self) -> NetworkSpec:
        if self._spec is None:
            raise not_loaded(self.name)
        return self._spec


def simulated() -> DeviceBank:
    """The kernel `rtl`: the core of the usual build, simulated by Verilator.

    Raises:
        ConfigError: what makes the model is not installed.
    """
    from bpn_edge.fpga.simulated import SimulatedCore  # noqa: PLC0415 - `fpga` needs no simulator

    return DeviceBank("rtl", Device(SimulatedCore(Build())))


def connected() -> DeviceBank:
    """The kernel `fpga`: the core that is at this machine, by mapped registers or at a serial line.

    Raises:
        ConfigError: there is no core, or another one.
    """
    from bpn_edge.fpga.connected import connected_core  # noqa: PLC0415 - `rtl` needs no device

    try:
        return DeviceBank("fpga", Device(connected_core()))
    except DeviceError as error:
        raise ConfigError(f"kernel 'fpga': {error}") from error
