"""Which core kernel `fpga` runs: the one that the environment names, else the UIO device that is called bpn."""

import os
from pathlib import Path

from bpn_edge.fpga.mapped import MappedCore
from bpn_edge.fpga.serial import SerialCore, Tty
from bpn_edge.fpga.transport import Transport
from bpn_shared.spec.config import ConfigError

WHERE = "BPN_FPGA"
"""Environment variable: a device such as /dev/uio0, /dev/mem@0xA0000000 or /dev/ttyUSB0."""
UIO = Path("/sys/class/uio")


def is_there() -> bool:
    """Whether something is where a core is looked for; what it is, is not asked."""
    named = os.environ.get(WHERE)
    return Path(named.partition("@")[0]).exists() if named else _uio() is not None


def connected_core() -> Transport:
    """The core at this machine.

    Raises:
        ConfigError: there is none; the message says where it was looked for.
    """
    named = os.environ.get(WHERE)
    if named is None:
        device = _uio()
        if device is not None:
            return MappedCore(device)
        raise ConfigError(
            "kernel 'fpga' finds no core: no UIO device is called bpn (load bitstream and device-tree overlay, "
            f"docs/fpga.md), and {WHERE} names none, such as /dev/uio0, /dev/mem@0xA0000000 or /dev/ttyUSB0"
        )
    if named.startswith(("/dev/tty", "/dev/pts/")):
        return SerialCore(Tty(named))
    path, _, address = named.partition("@")
    try:
        offset = int(address or "0", 0)
    except ValueError as error:
        raise ConfigError(
            f"{WHERE} = {named!r}: {address!r} is no address such as 0xA0000000"
        ) from error
    return MappedCore(path, offset)


def _uio() -> str | None:
    for device in sorted(UIO.glob("uio*")):
        if (device / "name").read_text().strip() == "bpn":
            return f"/dev/{device.name}"
    return None
