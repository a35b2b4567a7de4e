"""Who may do what at which key: the table that the router's access control is generated from.

A role may do what its rows here say and nothing else. Which robot sits in which slot of which run changes with
every lease, so rights are of roles; but a robot and its edge are of one site, which their keys name, so who has
a certificate of a site (`bpn_shared.bus.identity`) may act there and nowhere else.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

from bpn_shared.bus import keys
from bpn_shared.bus.keys import ANY
from bpn_shared.messages import episode
from bpn_shared.messages.base import MAX_CONTROL_BYTES
from bpn_shared.site import prefix_of

Role = Literal["dashboard", "learner", "edge", "robot_sim"]
"""Whom a service's certificate may name."""
ROUTER = "router"
"""Whom a router's certificate names."""

ROLES: tuple[Role, ...] = get_args(Role)
WORKERS: tuple[Role, ...] = ("learner", "edge", "robot_sim")

Flow = Literal["ingress", "egress"]
"""As the router sees it: what a role sends, what a role gets."""
MessageType = Literal[
    "put",
    "declare_subscriber",
    "query",
    "reply",
    "declare_queryable",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
]
"""Zenoh's names of what its access control can tell apart; `delete` is nobody's right."""

ENVELOPE_BYTES = 1024
"""Room for attachment and status beside a payload."""
MAX_PIXEL_BYTES = 512 * 1024
MAX_WEIGHTS_BYTES = 16 * 1024 * 1024


class Grant(NamedTuple):
    """One thing that a role may do."""

    role: Role
    flow: Flow
    message: MessageType
    key: str


@dataclass(frozen=True)
class Channel:
    """What travels at the keys of a pattern: who gives, who takes, and how large it may be.

    Attributes:
        way: "stream": givers publish, takers subscribe; "request": givers ask, takers answer; "token":
            givers hold liveliness tokens, takers watch them.
    """

    key: str
    way: Literal["stream", "request", "token"]
    givers: tuple[Role, ...] = ()
    takers: tuple[Role, ...] = ()
    max_bytes: int = MAX_CONTROL_BYTES

    def grants(self) -> Iterator[Grant]:
        """What this row permits."""
        giving, taking = _RIGHTS[self.way]
        for roles, rights in ((self.givers, giving), (self.takers, taking)):
            for role in roles:
                for flow, message in rights:
                    yield Grant(role, flow, message, self.key)


_Rights = tuple[tuple[Flow, MessageType], ...]
_RIGHTS: dict[str, tuple[_Rights, _Rights]] = {
    "stream": (
        (("ingress", "put"),),
        (("ingress", "declare_subscriber"), ("egress", "put")),
    ),
    "request": (
        (("ingress", "query"), ("egress", "reply")),
        (("ingress", "declare_queryable"), ("egress", "query"), ("ingress", "reply")),
    ),
    "token": (
        (("ingress", "liveliness_token"),),
        (
            ("ingress", "liveliness_query"),
            ("ingress", "declare_liveliness_subscriber"),
            ("egress", "liveliness_token"),
        ),
    ),
}

EVERYTHING = "bpn/**"
"""What one router passes on to another."""


def channels(site: str = ANY, own: str = ANY) -> tuple[Channel, ...]:
    """The rows of the table.

    Args:
        site: whose robots and edges are meant.
        own: a pattern of the workers who give, in the rows in which they bear their id.
    """
    return (
        # The loop
        Channel(keys.frame(ANY, ANY, site), "stream", ("robot_sim",), ("edge",), MAX_PIXEL_BYTES),
        Channel(keys.action(ANY, ANY, site), "stream", ("edge",), ("robot_sim",)),
        Channel(keys.reset(ANY, ANY, site), "request", ("edge",), ("robot_sim",)),
        Channel(keys.local_link(ANY, ANY, site, ANY), "token", ("robot_sim",), ("edge",)),
        Channel(keys.config(ANY), "request", ("edge", "robot_sim", "learner"), ("learner",)),
        Channel(keys.rendezvous(ANY), "request", ("learner",), ("learner",)),
        Channel(keys.next_episode(ANY), "request", ("edge",), ("learner",)),
        Channel(keys.episode(ANY), "request", ("edge",), ("learner",), episode.MAX_BYTES),
        Channel(keys.fault(ANY), "request", ("edge", "robot_sim"), ("learner",)),
        Channel(keys.weights(ANY), "stream", ("learner",), ("edge",), MAX_WEIGHTS_BYTES),
        Channel(keys.weights(ANY), "request", ("edge",), ("learner",), MAX_WEIGHTS_BYTES),
        Channel(keys.log(ANY, "learner"), "stream", ("learner",)),
        Channel(keys.log(ANY, "learner-$*"), "stream", ("learner",)),
        Channel(keys.log(ANY, "edge-$*"), "stream", ("edge",)),
        Channel(keys.log(ANY, "robot_sim-$*"), "stream", ("robot_sim",)),
        Channel(keys.log(ANY, ANY), "stream", takers=("learner",)),
        # For whoever watches
        Channel(
            keys.preview(ANY, ANY, site), "stream", ("robot_sim",), ("dashboard",), MAX_PIXEL_BYTES
        ),
        Channel(keys.decision(ANY, ANY, site), "stream", ("edge",), ("dashboard",)),
        Channel(keys.metrics(ANY, "learner", own), "stream", ("learner",)),
        Channel(keys.metrics(ANY, "edge", own), "stream", ("edge",)),
        Channel(keys.metrics(ANY, ANY, ANY), "stream", takers=("dashboard",)),
        *(Channel(keys.telemetry(role, own), "stream", (role,)) for role in ROLES),
        Channel(keys.telemetry(ANY, ANY), "stream", takers=("dashboard",)),
        *(Channel(keys.health(role, own), "request", ("dashboard",), (role,)) for role in ROLES),
        # Who is there
        *(Channel(keys.live(role, own), "token", (role,)) for role in ROLES),
        Channel(keys.live("learner", ANY), "token", takers=("edge",)),
        Channel(keys.live("edge", ANY), "token", takers=("learner",)),
        Channel(keys.live(ANY, ANY), "token", takers=("dashboard",)),
        # Who works where
        Channel(keys.lease_request(site), "request", WORKERS),
        Channel(keys.LEASE_REQUEST_OF_EARLIER, "request", WORKERS),
        Channel(keys.LEASE_REQUESTS, "request", takers=("dashboard",)),
        Channel(keys.serving(ANY, ANY, ANY), "token", ("dashboard",), ("dashboard",)),
        *(Channel(keys.lease(ANY, role, ANY, own), "token", (role,)) for role in WORKERS),
        Channel(keys.lease(ANY, ANY, ANY, ANY), "token", takers=("dashboard",)),
        *(Channel(keys.control(role, own), "request", ("dashboard",), (role,)) for role in WORKERS),
        Channel(keys.probe(), "request", ("dashboard",), ("robot_sim",)),
        # The router's own state, which answers itself and cannot be written
        Channel("@/**", "request", ("dashboard",)),
    )


CHANNELS = channels()


def grants() -> frozenset[Grant]:
    """Everything that a role without a site may do."""
    return frozenset(_knowing(ROLES).union(*(channel.grants() for channel in CHANNELS)))


def grants_at(site: str, roles: Collection[Role]) -> frozenset[Grant]:
    """What workers of these roles may do at a site: those rows alone, with its own name in place of any."""
    rows = channels(site, f"{prefix_of(site)}$*")
    of_site = (grant for row in rows for grant in row.grants() if grant.role in roles)
    return _knowing(roles).union(of_site)


def _knowing(roles: Collection[Role]) -> frozenset[Grant]:
    """Everyone is told where somebody subscribes or answers, whatever the pattern: without that a sender would
    not know that there is anyone to send to.
    """
    told: tuple[MessageType, ...] = ("declare_subscriber", "declare_queryable")
    return frozenset(
        Grant(role, "egress", message, EVERYTHING) for role in roles for message in told
    )
