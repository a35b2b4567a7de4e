"""What runs on a machine that has joined another one's bus, and the care of its certificate."""

import logging
import threading
from collections.abc import Collection
from datetime import UTC, datetime
from pathlib import Path

from bpn.pool import PoolSize, robots_and_edges
from bpn.supervisor import Service
from bpn_certificates.joining import Machine, UnreachableError
from bpn_shared.backoff import Backoff
from bpn_shared.bus.certificates import FOLDER_VARIABLE
from bpn_shared.bus.x509 import facts_of
from bpn_shared.errors import InputError, one_line

log = logging.getLogger(__name__)

_LOOK_S = 3600.0
_TRY_AGAIN_S, _TRY_AGAIN_AT_MOST_S = 60.0, 3600.0


def services_of_machine(
    machine: Machine, size: PoolSize, endpoint: str, gym_modules: Collection[str] = ()
) -> list[Service]:
    """A router of its own, by which it joins the other one, and its robots and edges.

    Args:
        endpoint: where this machine's router listens, for this machine alone.
    """
    folder = machine.folder.absolute()
    joined = ["--upstream", machine.endpoint, "--certificates", str(folder)]
    router = ["bpn_shared.bus.router", "--listen", endpoint, *joined]
    return [
        Service("router", router),
        *robots_and_edges(
            size,
            endpoint,
            lambda _role: {FOLDER_VARIABLE: str(folder)},  # whose machine this is
            gym_modules=gym_modules,
        ),
    ]


class Renewal:
    """Renews a machine's certificate when its end is near; the router takes the new one by itself."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._pauses = Backoff(_TRY_AGAIN_S, _TRY_AGAIN_AT_MOST_S)

    def follow(self, stop: threading.Event) -> None:
        """Looks now and then until `stop` is set. The other machine may take its time to answer."""
        while not stop.wait(self.look()):
            pass

    def look(self) -> float:
        """Renews it if its end is near; returns the seconds until the next look."""
        try:
            if not _is_near_end(self._machine.files.certificate):
                return _LOOK_S
            self._machine.renew()
        except (InputError, UnreachableError, OSError, ValueError) as error:
            log.warning("this machine's certificate cannot be renewed: %s", one_line(error))
            return self._pauses.next_s()
        self._pauses.reset()
        log.warning("this machine's certificate was renewed")
        return _LOOK_S


def _is_near_end(certificate: Path) -> bool:
    return facts_of(certificate).life.is_near_end(datetime.now(UTC))
