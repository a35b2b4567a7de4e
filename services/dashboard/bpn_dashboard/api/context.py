"""What the operations work with, and who asks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Annotated, cast

from fastapi import Depends
from starlette.requests import HTTPConnection

from bpn_dashboard.access.limits import WrongTokens
from bpn_dashboard.access.roles import Identity, Role
from bpn_dashboard.access.tokens import Tokens, secret_key
from bpn_dashboard.api.pages import Cursors
from bpn_dashboard.api.problems import ApiError
from bpn_dashboard.database.engine import Database
from bpn_dashboard.hub.topology import Topology, TopologySnapshot
from bpn_dashboard.registry.store import RunStore
from bpn_dashboard.registry.versions import Refused
from bpn_dashboard.registry.workplace import ConnectedWorkers
from bpn_dashboard.series.ingest import Ingest
from bpn_dashboard.series.query import SeriesQueries
from bpn_shared.runs.creation import Workplace
from bpn_shared.service import Counters


@dataclass
class Context:
    """The parts of the dashboard that its operations use.

    Attributes:
        topology: who is alive and talks to whom.
        place: the machines that will do new runs.
        obstacle: what keeps workers from being given work; None: nothing.
        read_only: why nothing may be changed here; None: it may.
        refused: the workers that ask for work and cannot be used.
        secure: browsers reach the dashboard over TLS.
        open_metrics: /metrics needs no token from loopback.
    """

    database: Database
    runs: RunStore
    ingest: Ingest
    counters: Counters
    place: Workplace = field(default_factory=ConnectedWorkers)
    topology: Callable[[], TopologySnapshot] = Topology().snapshot
    obstacle: Callable[[], str | None] = lambda: None
    read_only: Callable[[], str | None] = lambda: None
    refused: Callable[[], Sequence[Refused]] = lambda: ()
    secure: bool = False
    open_metrics: bool = False
    wrong_tokens: WrongTokens = field(default_factory=WrongTokens)

    def __post_init__(self) -> None:
        self.tokens = Tokens(self.database)
        self.cursors = Cursors(secret_key(self.database, "cursors"))
        self.series = SeriesQueries(self.database)

    @property
    def cookie(self) -> str:
        """The session cookie's name; `__Host-` binds it to this host and TLS."""
        return "__Host-bpn_session" if self.secure else "bpn_session"


def context_of(connection: HTTPConnection) -> Context:
    """The context of the application that was asked."""
    return cast(Context, connection.app.state.context)


def identify(connection: HTTPConnection) -> Identity | None:
    """Who asks, by bearer token or session cookie, over HTTP or WebSocket; None if nobody known.

    Raises:
        ApiError: too many wrong tokens came from there.
    """
    context = context_of(connection)
    scheme, _, bearer = connection.headers.get("authorization", "").partition(" ")
    secret = bearer if scheme.lower() == "bearer" else connection.cookies.get(context.cookie)
    if not secret:
        return None
    client = check_guesses(connection)
    identity = context.tokens.identify(secret)
    if identity is None:
        context.wrong_tokens.add(client)
    return identity


def check_guesses(connection: HTTPConnection) -> str:
    """The client's address, if it may try a token now.

    Raises:
        ApiError: too many wrong ones came from there.
    """
    client = connection.client.host if connection.client else ""
    wait_s = context_of(connection).wrong_tokens.wait_s(client)
    if wait_s > 0:
        raise ApiError(
            429,
            "too-many-wrong-tokens",
            f"too many wrong tokens; try again in {wait_s:.0f} s",
            {"Retry-After": f"{wait_s:.0f}"},
        )
    return client


def _required(role: Role) -> Callable[[HTTPConnection], Identity]:
    def check(connection: HTTPConnection) -> Identity:
        identity = identify(connection)
        if identity is None:
            raise ApiError(
                401,
                "not-logged-in",
                "no valid session or token; open the link that the dashboard printed",
                {"WWW-Authenticate": "Bearer"},
            )
        if not identity.may(role):
            raise ApiError(403, "role", f"this needs the role {role}; yours is {identity.role}")
        return identity

    check.role = role  # type: ignore[attr-defined] # read by the documentation of operations
    return check


Parts = Annotated[Context, Depends(context_of)]
Viewer = Annotated[Identity, Depends(_required("viewer"))]
Operator = Annotated[Identity, Depends(_required("operator"))]
Admin = Annotated[Identity, Depends(_required("admin"))]
