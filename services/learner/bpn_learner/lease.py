"""For how long an edge is believed to play what it was given."""

import time
from collections.abc import Container
from dataclasses import dataclass
from typing import Self

from bpn_shared.messages.control import NextEpisode
from bpn_shared.spec.config import RunConfig

LEASE_S = 60.0
"""Grace on top of the time that an episode takes in realtime pacing."""


@dataclass(frozen=True, slots=True)
class Lease:
    """Who plays an episode, and until when, on the monotonic clock, that is believed."""

    slot: int
    worker: str
    expires_s: float

    @classmethod
    def begin(cls, asked: NextEpisode, config: RunConfig) -> Self:
        """A lease from now on, for who asked."""
        length_s = LEASE_S + config.steps * config.task_spec.control_period_s
        return cls(asked.slot, asked.worker, time.monotonic() + length_s)

    def holds(self, alive: Container[str]) -> bool:
        """Whether it is still believed, with the edges that are alive."""
        return self.worker in alive and time.monotonic() < self.expires_s
