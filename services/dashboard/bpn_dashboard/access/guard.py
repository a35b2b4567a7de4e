"""Before any request: where it comes from; after any response: what browsers must not do with it.

Checks of Host stop names that were rebound to loopback; checks of Origin and Sec-Fetch-Site stop other sites'
pages, on WebSockets too, which browsers open to any site without asking.
"""

import re
import uuid
from collections.abc import Iterable
from dataclasses import dataclass

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from bpn_dashboard.access.connections import Connections
from bpn_dashboard.api.problems import Problem, problem_response

CONTENT_SECURITY_POLICY = "; ".join(
    (
        "default-src 'self'",
        "img-src 'self' blob: data:",
        "object-src 'none'",
        "base-uri 'self'",
        "form-action 'self'",
        "frame-ancestors 'none'",
    )
)
_HEADERS = {
    "content-security-policy": CONTENT_SECURITY_POLICY,
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "permissions-policy": "camera=(), geolocation=(), microphone=()",
    "x-frame-options": "DENY",
}
MAX_BODY_BYTES = 1024 * 1024
_SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
_HOST = re.compile(r"(\[[0-9a-f:.]+\]|[a-z0-9._-]+)(?::[0-9]{1,5})?", re.IGNORECASE)
_LOOPBACK_NAMES = ("localhost", "127.0.0.1", "::1")


@dataclass(frozen=True)
class Refusal:
    """Why a request may not go on."""

    status: int
    kind: str
    detail: str


class Guard:
    """ASGI around the whole application: refuses what comes from elsewhere, adds headers and request ids.

    Args:
        hosts: names by which the dashboard is reached, beside those of loopback.
        prefix: a path below which it is found, too, as by a proxy that passes it on; without a slash at its end.
        connections: is told how far requests have come; None: of a server without limits.
        max_body_bytes: of a request that says its length; the application bounds the others.
    """

    def __init__(
        self,
        app: ASGIApp,
        hosts: Iterable[str] = (),
        *,
        prefix: str = "",
        connections: Connections | None = None,
        max_body_bytes: int = MAX_BODY_BYTES,
    ) -> None:
        self.app = app
        self._connections = connections
        self._prefix = prefix
        self._max_body_bytes = max_body_bytes
        self._hosts = frozenset(host.lower() for host in (*_LOOPBACK_NAMES, *hosts))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        if self._prefix and f"{scope['path']}/".startswith(f"{self._prefix}/"):
            scope = {**scope, "path": scope["path"].removeprefix(self._prefix) or "/"}
        if self._connections is not None:
            receive, send = _within_limits(scope, headers, receive, send, self._connections)
        request_id = uuid.uuid4().hex  # ours: who reads logs must be able to trust it
        scope.setdefault("state", {})["request_id"] = request_id
        refusal = refuse(scope, headers, self._hosts)
        length = headers.get("content-length", "0")
        if refusal is None and length.isdecimal() and int(length) > self._max_body_bytes:
            refusal = Refusal(413, "too-large", f"the limit is {self._max_body_bytes} bytes")

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                answer = MutableHeaders(raw=message.setdefault("headers", []))
                answer["x-request-id"] = request_id
                for name, value in _HEADERS.items():
                    answer[name] = value
                if scope["path"].startswith("/api/"):
                    answer.setdefault("cache-control", "no-store")
            await send(message)

        if refusal is None:
            await self.app(scope, receive, send_guarded)
        elif scope["type"] == "websocket":
            await receive()  # the handshake, which is answered with 403
            await send({"type": "websocket.close", "code": 4403, "reason": refusal.detail})
        else:
            problem = Problem.of(refusal.status, refusal.kind, refusal.detail)
            await problem_response(problem, request_id)(scope, receive, send_guarded)


def refuse(scope: Scope, headers: Headers, hosts: frozenset[str]) -> Refusal | None:
    """Why a request may not go on; None if it may."""
    host = headers.get("host", "")
    if (len(headers.getlist("host")), _hostname(host) in hosts) != (1, True):
        return Refusal(
            421,
            "unknown-host",
            "this dashboard is not reached by that name; start it with --allow-host NAME",
        )
    if scope["type"] == "http" and scope["method"] in _SAFE_METHODS:
        return None
    origin = headers.get("origin")
    if not all(_same_origin(one, host) for one in headers.getlist("origin")):
        return Refusal(403, "cross-origin", "the request comes from another site's page")
    if headers.get("sec-fetch-site", "none") not in ("same-origin", "none"):
        return Refusal(403, "cross-origin", "the request comes from another site's page")
    if scope["type"] == "websocket" and origin is None and "authorization" not in headers:
        return Refusal(
            403, "cross-origin", "browsers say their origin, scripts have a bearer token"
        )
    return None


def _same_origin(origin: str, host: str) -> bool:
    """Whether a page of that origin came from this host and port; a proxy may have ended its TLS."""
    scheme, separator, authority = origin.partition("://")
    return scheme in ("http", "https") and bool(separator) and authority.lower() == host.lower()


def _hostname(host: str) -> str | None:
    """The name without its port; None if it is neither a name nor an address."""
    match = _HOST.fullmatch(host)
    return match[1].strip("[]").lower() if match else None


def _within_limits(
    scope: Scope, headers: Headers, receive: Receive, send: Send, connections: Connections
) -> tuple[Receive, Send]:
    """`receive` and `send` that tell how far the request has come, and end clients that take nothing."""
    peer = scope.get("client") and tuple(scope["client"])
    if scope["type"] == "websocket":  # which has deadlines of its own
        connections.request_is_whole(peer)
        return receive, send
    if headers.get("content-length", "0") == "0" and "transfer-encoding" not in headers:
        connections.request_is_whole(peer)

    async def receive_within() -> Message:
        message = await receive()
        if message["type"] == "http.request" and not message.get("more_body", False):
            connections.request_is_whole(peer)
        return message

    async def send_within(message: Message) -> None:
        connections.request_is_whole(peer)
        with connections.sending(peer):
            await send(message)
        if message["type"] == "http.response.body" and not message.get("more_body", False):
            connections.wait_for_request(peer)

    return receive_within, send_within
