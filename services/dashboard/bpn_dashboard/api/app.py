"""The application: every operation under /api/v1, health, metrics, the UI, behind the guard."""

from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractAsyncContextManager
from typing import Any

from fastapi import APIRouter, FastAPI

from bpn_dashboard.access.connections import Connections
from bpn_dashboard.access.guard import MAX_BODY_BYTES, Guard
from bpn_dashboard.api import (
    artefacts,
    comparison,
    episodes,
    logs,
    overviews,
    problems,
    prometheus,
    queue,
    runs,
    series,
    session,
    static,
    sweeps,
    system,
    trash,
    views,
    watch,
)
from bpn_dashboard.api.context import Context, Viewer
from bpn_dashboard.api.openapi import describe

PREFIX = "/api/v1"

Lifespan = Callable[[FastAPI], AbstractAsyncContextManager[None]]


class Application(Guard):
    """The guard with what it guards.

    Attributes:
        api: the application inside.
    """

    def __init__(
        self, api: FastAPI, hosts: Iterable[str], prefix: str, connections: Connections | None
    ) -> None:
        super().__init__(api, hosts, prefix=prefix, connections=connections)
        self.api = api


def create_app(
    context: Context,
    *,
    hosts: Iterable[str] = (),
    prefix: str = "",
    lifespan: Lifespan | None = None,
    routers: Sequence[APIRouter] = (),
) -> Application:
    """The application as ASGI.

    Args:
        hosts: names by which browsers reach the dashboard, beside loopback's.
        prefix: the path at which they find it, without a slash at its end, if that is not the root.
        routers: more routes, such as the live hub's, with their whole paths.
    """
    app = FastAPI(
        title="bpn dashboard",
        version="1",
        summary="Runs of binarized-policy learning: start, watch, compare.",
        openapi_url=None,  # below, for who is logged in
        docs_url=None,  # its pages come from a CDN
        redoc_url=None,
        lifespan=lifespan,
        max_body_size=MAX_BODY_BYTES,
        redirect_slashes=False,
    )
    app.state.context = context
    problems.install(app)
    # Paths with a name in place of a run's id come before those with the id.
    for module in (
        session, overviews, queue, runs, trash, sweeps, series, comparison, artefacts, episodes, logs,
        system, views, watch,
    ):  # fmt: skip
        app.include_router(module.router, prefix=PREFIX)

    @app.get(f"{PREFIX}/openapi.json", operation_id="getOpenApi", tags=["system"])
    def openapi_document(_who: Viewer) -> dict[str, Any]:
        """This interface as OpenAPI 3.1."""
        return app.openapi()

    app.include_router(system.health_router)
    app.include_router(prometheus.router)
    for router in routers:
        app.include_router(router)
    app.include_router(static.ui_routes(prefix=prefix))
    describe(app)
    return Application(app, hosts, prefix, context.connections)
