"""What the operations work with, and who asks."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, cast

from fastapi import Depends
from starlette.requests import HTTPConnection

from bpn_dashboard.access.connections import Connections
from bpn_dashboard.access.limits import WrongTokens
from bpn_dashboard.access.roles import Identity, Role
from bpn_dashboard.access.tokens import Tokens, secret_key
from bpn_dashboard.api.pages import Cursors
from bpn_dashboard.api.problems import ApiError
from bpn_dashboard.certificates import Certificate
from bpn_dashboard.database.engine import Database
from bpn_dashboard.hub.samples import Samples
from bpn_dashboard.hub.topology import Topology, TopologySnapshot
from bpn_dashboard.registry.removals import Removals
from bpn_dashboard.registry.saved_views import SavedViews
from bpn_dashboard.registry.store import RunStore
from bpn_dashboard.registry.versions import Refused
from bpn_dashboard.registry.view import RegistryView
from bpn_dashboard.registry.workplace import ConnectedWorkers
from bpn_dashboard.series.ingest import Ingest
from bpn_dashboard.series.query import SeriesQueries
from bpn_shared.counters import Counters
from bpn_shared.runs.creation import Workplace
from bpn_shared.runs.trash import DAY_S, KEPT_DAYS, Trash

COOKIE = "bpn_session"
"""How the name of the session cookie begins."""


@dataclass
class Context:
    """The parts of the dashboard that its operations use.

    Attributes:
        topology: who is alive and talks to whom.
        refusals: how much workers have refused, by their kind.
        registry: what the registry knows of runs beside their rows.
        certificates: the dashboard's own and the router's.
        place: the machines that will do new runs.
        obstacle: what keeps workers from being given work; None: nothing.
        read_only: why nothing may be changed here; None: it may.
        refused: the workers that ask for work and cannot be used.
        secure: browsers reach the dashboard over TLS.
        open_metrics: /metrics needs no token from loopback.
        connections: of the server, if it limits them.
        state_dir: the folder that is the dashboard's alone; None: that of the runs.
        trash_kept_s: how long runs that are removed are kept.
        webhook_trouble: why the last alert was not sent; empty: it was; None: there is nowhere to send it.
    """

    database: Database
    runs: RunStore
    ingest: Ingest
    counters: Counters
    place: Workplace = field(default_factory=ConnectedWorkers)
    topology: Callable[[], TopologySnapshot] = Topology().snapshot
    refusals: Callable[[], Mapping[str, int]] = dict
    registry: Callable[[], RegistryView] = RegistryView
    certificates: Callable[[], Sequence[Certificate]] = list
    obstacle: Callable[[], str | None] = lambda: None
    read_only: Callable[[], str | None] = lambda: None
    refused: Callable[[], Sequence[Refused]] = lambda: ()
    secure: bool = False
    open_metrics: bool = False
    wrong_tokens: WrongTokens = field(default_factory=WrongTokens)
    connections: Connections | None = None
    state_dir: Path | None = None
    trash_kept_s: float = KEPT_DAYS * DAY_S
    webhook_trouble: Callable[[], str | None] = lambda: None

    def __post_init__(self) -> None:
        trash = Trash(self.runs.runs_dir, self.trash_kept_s)
        self.removals = Removals(self.database, self.runs, trash)
        self.runs.audience.mourn(self.ingest.forget)
        self.tokens = Tokens(self.database)
        self.cursors = Cursors(secret_key(self.database, "cursors"))
        self.series = SeriesQueries(self.database)
        self.views = SavedViews(self.runs.runs_dir)
        self.samples = Samples(self.database, self.topology)
        self._instance = secret_key(self.database, "instance")[:4].hex()

    @property
    def cookie(self) -> str:
        """The session cookie's name: cookies know no port, so each dashboard of a host has its own.

        `__Host-` binds it to this host and TLS.
        """
        return f"{'__Host-' if self.secure else ''}{COOKIE}_{self._instance}"


def context_of(connection: HTTPConnection) -> Context:
    """The context of the application that was asked."""
    return cast(Context, connection.app.state.context)


def identify(connection: HTTPConnection) -> Identity | None:
    """Who asks, by bearer token or session cookie, over HTTP or WebSocket; None if nobody known.

    Raises:
        ApiError: the bearer is wrong, and too many wrong ones came from there.
    """
    context = context_of(connection)
    scheme, _, bearer = connection.headers.get("authorization", "").partition(" ")
    is_bearer = scheme.lower() == "bearer"
    secret = bearer if is_bearer else connection.cookies.get(context.cookie)
    identity = context.tokens.identify(secret) if secret else None
    if identity is None and is_bearer and secret:
        wrong_token(connection)  # a cookie that has ended is no guess
    return identity


def wrong_token(connection: HTTPConnection) -> None:
    """Counts a wrong token. Who has a right one is never asked to wait because of others.

    Raises:
        ApiError: too many wrong ones came from there.
    """
    client = connection.client.host if connection.client else ""
    limit = context_of(connection).wrong_tokens
    wait_s = limit.wait_s(client)
    if wait_s > 0:
        raise ApiError(
            429,
            "too-many-wrong-tokens",
            f"the token is wrong, as many before it; try another one in {wait_s:.0f} s",
            {"Retry-After": f"{wait_s:.0f}"},
        )
    limit.add(client)


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
