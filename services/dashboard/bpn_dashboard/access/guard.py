"""Before any request: where it comes from; after any response: what browsers must not do with it.

Checks of Host stop names that were rebound to loopback; checks of Origin and Sec-Fetch-Site stop other sites'
pages, on WebSockets too, which browsers open to any site without asking.
"""

import re
import uuid
from collections.abc import Iterable
from dataclasses import dataclass
from ipaddress import ip_address
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from bpn_dashboard.api.problems import Problem, problem_response

CONTENT_SECURITY_POLICY = "; ".join(
    (
        "default-src 'self'",
        "img-src 'self' blob: data:",
        "object-src 'none'",
        "base-uri 'none'",
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
_REQUEST_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")
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
        max_body_bytes: of a request that says its length; the application bounds the others.
    """

    def __init__(
        self, app: ASGIApp, hosts: Iterable[str] = (), *, max_body_bytes: int = MAX_BODY_BYTES
    ) -> None:
        self.app = app
        self._max_body_bytes = max_body_bytes
        self._hosts = frozenset(host.lower() for host in (*_LOOPBACK_NAMES, *hosts))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        given = headers.get("x-request-id", "")
        request_id = given if _REQUEST_ID.fullmatch(given) else uuid.uuid4().hex
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
    if origin is not None and not _same_origin(origin, host):
        return Refusal(403, "cross-origin", "the request comes from another site's page")
    if headers.get("sec-fetch-site", "none") not in ("same-origin", "none"):
        return Refusal(403, "cross-origin", "the request comes from another site's page")
    if scope["type"] == "websocket" and origin is None and "authorization" not in headers:
        return Refusal(
            403, "cross-origin", "browsers say their origin, scripts have a bearer token"
        )
    return None


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches that address."""
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


def _same_origin(origin: str, host: str) -> bool:
    """Whether a page of that origin came from this host and port; a proxy may have ended its TLS."""
    parts = urlsplit(origin)
    return parts.scheme in ("http", "https") and parts.netloc.lower() == host.lower()


def _hostname(host: str) -> str | None:
    try:
        return urlsplit(f"//{host}").hostname
    except ValueError:
        return None
