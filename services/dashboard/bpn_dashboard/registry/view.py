"""What the registry knows beside the rows, for who counts."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from bpn_shared.messages.lease import Role
from bpn_shared.runtime.watchdog import CauseKind


@dataclass(frozen=True)
class RegistryView:
    """At one moment.

    Attributes:
        causes: by run that waits, why.
        advanced_unix_s: by run that is worked on, when it ended an iteration or began this attempt.
        vacant: by role, the places in wanted runs that nobody has.
    """

    causes: Mapping[str, frozenset[CauseKind]] = field(default_factory=dict)
    advanced_unix_s: Mapping[str, float] = field(default_factory=dict)
    vacant: Mapping[Role, int] = field(default_factory=dict)
