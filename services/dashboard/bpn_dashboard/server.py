"""The HTTP server: where it listens, with which limits, and how it ends."""

import hashlib
import logging
import socket
import ssl
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import uvicorn
from starlette.types import ASGIApp

from bpn_dashboard.access.connections import BACKLOG, Listener
from bpn_dashboard.hub.websocket import UVICORN_OPTIONS
from bpn_shared.errors import one_line
from bpn_shared.spec.config import ConfigError

log = logging.getLogger(__name__)

_SHUTDOWN_S = 2
_RENEWAL_S = 10.0
"""Between two looks whether there is a new certificate."""
_QUEUE = 1024
"""Connections that wait to be accepted; the system has a limit of its own."""


class Server(uvicorn.Server):
    """Serves an application at a socket that listens already.

    Leaves signals to us: uvicorn's own handling ends the process by the signal, past our clean-up.
    """

    def __init__(
        self, app: ASGIApp, listener: Listener, certificate: Path | None, key: Path | None
    ) -> None:
        config = uvicorn.Config(
            app,
            log_config=None,
            access_log=False,
            server_header=False,
            proxy_headers=False,
            lifespan="on",
            backlog=BACKLOG,  # how many asyncio accepts in a row
            timeout_graceful_shutdown=_SHUTDOWN_S,
            ssl_certfile=certificate,
            ssl_keyfile=key,
            **UVICORN_OPTIONS,
        )
        super().__init__(config)
        self._listener = listener
        self._certificate, self._key = certificate, key
        self._shown, self._refused = self._certificate_digest(), b""

    def serve_until(self, stop: threading.Event) -> None:
        """Serves until the event is set."""
        self._stop = stop

        def exit_after() -> None:
            stop.wait()
            self.should_exit = True

        threading.Thread(target=exit_after, daemon=True).start()
        self.run(sockets=[self._listener])

    def _renew(self) -> None:
        while not self._stop.wait(_RENEWAL_S):
            try:
                self._take_renewed_certificate()
            except Exception:
                log.exception("looking for a new certificate failed")

    def _take_renewed_certificate(self) -> None:
        """Shows whoever connects from now on the certificate that lies there now."""
        certificate, context, found = self._certificate, self.config.ssl, self._certificate_digest()
        if certificate is None or context is None or found in (b"", self._shown):
            return
        try:
            # First where a wrong pair does no harm; files that change meanwhile wait for the next look.
            ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, self._key)
            if self._certificate_digest() != found:
                return
            context.load_cert_chain(certificate, self._key)
        except (OSError, ValueError) as error:  # half of it is written, or it is wrong
            if found != self._refused:
                reason = one_line(error)
                log.warning("the new certificate %s cannot be used yet: %s", certificate, reason)
            self._refused = found
        else:
            log.info("the pages are shown with the new certificate %s", certificate)
            self._shown = found

    def _certificate_digest(self) -> bytes:
        files = [path for path in (self._certificate, self._key) if path is not None]
        try:
            return hashlib.sha256(b"\0".join(path.read_bytes() for path in files)).digest()
        except OSError:
            return b""  # in the middle of being replaced

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Starts to accept."""
        await super().startup(sockets=sockets)
        if not self.should_exit:
            self._listener.listen(_QUEUE)  # the queue that `backlog` has made short
            if self._certificate is not None:
                threading.Thread(target=self._renew, daemon=True).start()

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Signals are ours."""
        yield


def listen(host: str, port: int) -> Listener:
    """A socket that listens; its connections have no limits yet.

    Raises:
        ConfigError: the address cannot be had.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = Listener(family)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
        listener.listen()  # who follows the link at once waits for us, and is not refused
    except (OSError, OverflowError) as error:
        listener.close()
        reason = error.strerror if isinstance(error, OSError) else "ports are 0 to 65535"
        raise ConfigError(f"--host {host} --port {port}: {reason}; try --port 0") from error
    return listener
