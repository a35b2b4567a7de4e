"""What a client can subscribe to, by name, and how each topic is delivered."""

import re
from dataclasses import dataclass
from typing import Literal, NamedTuple
from uuid import UUID

from bpn_dashboard.hub.protocol import ProtocolError

Kind = Literal["camera", "actions", "metrics", "logs", "runs", "alerts", "topology"]

_RUN = r"(?P<run>[0-9a-f]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12})"
_SLOT = r"(?P<slot>0|[1-9][0-9]{0,2})"
_FORMS: dict[Kind, re.Pattern[str]] = {
    "camera": re.compile(f"camera/{_RUN}/{_SLOT}"),
    "actions": re.compile(f"actions/{_RUN}/{_SLOT}"),
    "metrics": re.compile(f"metrics/{_RUN}"),
    "logs": re.compile(f"logs/{_RUN}"),
    "runs": re.compile("runs"),
    "alerts": re.compile("alerts"),
    "topology": re.compile("topology"),
}


@dataclass(frozen=True, slots=True)
class Delivery:
    """How a kind of topic is delivered.

    Attributes:
        kept: messages that are kept for those who come late or read slowly; 1: only the newest counts.
        rate_hz: most messages a second; of topics that keep them, how often new ones are looked for.
        linger_s: how long what was kept outlives the last subscriber, for one who only lost the connection.
    """

    kept: int
    rate_hz: float
    linger_s: float = 0.0

    @property
    def newest_only(self) -> bool:
        return self.kept == 1


DELIVERY: dict[Kind, Delivery] = {
    "camera": Delivery(kept=1, rate_hz=30),
    "actions": Delivery(kept=1, rate_hz=20, linger_s=60),  # who comes back sees the last decision
    "metrics": Delivery(kept=1000, rate_hz=5, linger_s=60),
    "logs": Delivery(kept=2000, rate_hz=5, linger_s=60),
    "runs": Delivery(kept=1000, rate_hz=5),
    "alerts": Delivery(kept=100, rate_hz=2),
    "topology": Delivery(kept=1, rate_hz=1),
}


class Topic(NamedTuple):
    """One topic; `str` gives its name."""

    kind: Kind
    run: UUID | None = None
    slot: int | None = None

    def __str__(self) -> str:
        parts = (self.kind, self.run, self.slot)
        return "/".join(str(part) for part in parts if part is not None)

    @classmethod
    def parse(cls, name: str) -> "Topic":
        """The topic of that name.

        Raises:
            ProtocolError: there is none; the message lists the forms.
        """
        for kind, form in _FORMS.items():
            if match := form.fullmatch(name):
                parts = match.groupdict()
                run, slot = parts.get("run"), parts.get("slot")
                return cls(kind, UUID(run) if run else None, int(slot) if slot else None)
        raise ProtocolError(
            f"topic {name[:80]!r} is unknown; there are camera/RUN/SLOT, actions/RUN/SLOT, metrics/RUN, "
            "logs/RUN, runs, alerts, topology"
        )
