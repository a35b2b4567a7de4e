"""Workers that ask for work and cannot be used, because they speak another protocol."""

import logging
from typing import NamedTuple

from bpn_shared.messages.lease import LeaseRequest, Role
from bpn_shared.version import PROTOCOL, VERSION

log = logging.getLogger(__name__)

FORGET_S = 120.0
"""After its last question: a refused worker asks every minute at least."""


class Refused(NamedTuple):
    """A worker that is refused, and why."""

    role: Role
    worker: str
    reason: str
    at_s: float


def why_refused(asked: LeaseRequest) -> str | None:
    """What keeps a worker from being used here; None: nothing."""
    if asked.protocol == PROTOCOL:
        return None
    version = f"bpn {asked.version}" if asked.version else "a bpn that does not tell its version"
    return (
        f"{asked.role} {asked.worker} speaks protocol {asked.protocol} ({version}), this registry {PROTOCOL}: "
        f"install bpn {VERSION} there"
    )


class Refusals:
    """Remembers whom, for those who wonder why nobody works. Not thread-safe."""

    def __init__(self) -> None:
        self._refused: dict[str, Refused] = {}

    def note(self, asked: LeaseRequest, reason: str, now_s: float) -> None:
        """A worker asked and was refused."""
        if asked.worker not in self._refused:
            log.warning("%s", reason)
        self._refused[asked.worker] = Refused(asked.role, asked.worker, reason, now_s)

    def current(self, now_s: float) -> list[Refused]:
        """Those that asked not long ago."""
        self._refused = {
            worker: refused
            for worker, refused in self._refused.items()
            if now_s - refused.at_s <= FORGET_S
        }
        return list(self._refused.values())
