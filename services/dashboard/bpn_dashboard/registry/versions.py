"""Workers that are there and cannot be used, because they speak another protocol."""

import logging
from typing import NamedTuple, get_args

from bpn_shared.messages.lease import LeaseRequest, Role
from bpn_shared.messages.telemetry import Telemetry
from bpn_shared.runtime.service import protocol_of
from bpn_shared.version import PROTOCOL, VERSION

log = logging.getLogger(__name__)

_NO_VERSION = "a bpn that does not tell its version"
FORGET_S = 120.0
"""After its last question: a refused worker asks every minute at least."""


class Refused(NamedTuple):
    """A worker that is refused, and why."""

    role: str
    worker: str
    reason: str
    at_s: float


def why_refused(asked: LeaseRequest) -> str | None:
    """What keeps a worker from being used here; None: nothing."""
    version = f"bpn {asked.version}" if asked.version else _NO_VERSION
    return _sentence(asked.role, asked.worker, asked.protocol, version)


def why_reported(report: Telemetry) -> str | None:
    """The same of a worker that tells how it is."""
    if report.kind not in get_args(Role):  # no worker: a dashboard
        return None
    version = f"bpn {report.version}" if report.version else _NO_VERSION
    return _sentence(report.kind, report.worker, report.protocol, version)


def why_foreign(role: str, worker: str) -> str | None:
    """The same of a worker that only its token tells of: it has its place from somebody else."""
    told = protocol_of(worker)
    return None if told is None else _sentence(role, worker, told, "as its token tells")


def _sentence(role: str, worker: str, protocol: int, version: str) -> str | None:
    if protocol == PROTOCOL:
        return None
    return (
        f"{role} {worker} speaks protocol {protocol} ({version}), this registry {PROTOCOL}: "
        f"install bpn {VERSION} there"
    )


class RefusedWorkers:
    """Remembers whom, for those who wonder why nobody works. Not thread-safe."""

    def __init__(self) -> None:
        self._refused: dict[str, Refused] = {}
        self._foreign: dict[str, Refused] = {}

    def note(self, role: str, worker: str, reason: str, now_s: float) -> None:
        """A worker asked and was refused, or told how it is and cannot be used."""
        if worker not in self._refused | self._foreign:
            log.warning("%s", reason)
        self._refused[worker] = Refused(role, worker, reason, now_s)

    def appeared(self, role: str, worker: str, now_s: float) -> None:
        """A worker's token came."""
        if (reason := why_foreign(role, worker)) is not None:
            log.warning("%s", reason)
            self._foreign[worker] = Refused(role, worker, reason, now_s)

    def gone(self, worker: str) -> None:
        """Its token went."""
        self._foreign.pop(worker, None)

    def current(self, now_s: float) -> list[Refused]:
        """Those that asked or reported not long ago, and those whose token tells another protocol."""
        self._refused = {
            worker: refused
            for worker, refused in self._refused.items()
            if now_s - refused.at_s <= FORGET_S
        }
        return list((self._foreign | self._refused).values())
