"""By which addresses other machines may reach this one."""

import contextlib
import fcntl
import socket
import struct

from bpn_shared.bus.address import is_loopback

_ADDRESS_OF_INTERFACE = 0x8915  # SIOCGIFADDR
_ELSEWHERE = ("192.0.2.1", 9)  # of nobody; nothing is sent


def own_addresses() -> list[str]:
    """This machine's IPv4 addresses, the one by which it reaches others first; none without a network."""
    found = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        with contextlib.suppress(OSError):  # no route leads elsewhere
            probe.connect(_ELSEWHERE)
            found.append(str(probe.getsockname()[0]))
        for _, name in socket.if_nameindex():
            with contextlib.suppress(OSError):  # an interface without an address
                request = struct.pack("256s", name.encode()[:15])
                answer = fcntl.ioctl(probe.fileno(), _ADDRESS_OF_INTERFACE, request)
                found.append(socket.inet_ntoa(answer[20:24]))
    return [address for address in dict.fromkeys(found) if not is_loopback(address)]
