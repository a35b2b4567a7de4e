"""`bpn-enrolment`: admits machines that bring an invitation's token, and renews their certificates later.

HTTPS with the router's certificate. Whoever asks for the authority's certificate gets it: the token has its
fingerprint. A machine's private key never comes here; it sends a signing request.
"""

import argparse
import contextlib
import json
import logging
import socket
import ssl
import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from bpn_certificates.book import Book, JoinRefusedError
from bpn_certificates.command import separated
from bpn_certificates.folders import authority_in
from bpn_certificates.office import Office
from bpn_shared.bus.access import ROUTER
from bpn_shared.bus.certificates import CertificateFiles
from bpn_shared.counters import Counters
from bpn_shared.errors import InputError, one_line
from bpn_shared.runtime.heartbeat import Heartbeat
from bpn_shared.runtime.service import end_with_supervisor, set_up_logging, stop_on_signals
from bpn_shared.version_option import add_version_option

log = logging.getLogger("bpn_enrolment")

AUTHORITY_PATH, MACHINES_PATH, RENEWALS_PATH = "/authority", "/machines", "/renewals"
MAX_BODY_BYTES = 16 * 1024
_CONNECTIONS = 32
_SILENT_S, _WHOLE_S = 10.0, 30.0
"""How long a connection may say nothing, and last altogether."""


class EnrolmentServer(ThreadingHTTPServer):
    """The office's door, until it is shut down; a connection that says nothing keeps nobody else out for long.

    Args:
        address: host and port.
        router_port: where machines that joined find the router, at the host by which they came.
    """

    daemon_threads = True
    request_queue_size = 64

    def __init__(self, address: tuple[str, int], folder: Path, router_port: int) -> None:
        self.address_family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
        super().__init__(address, _Handler)
        self.office, self.router_port, self.counters = Office(folder), router_port, Counters()
        self._files = CertificateFiles.in_folder(folder / ROUTER)
        self._places = threading.BoundedSemaphore(_CONNECTIONS)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """TLS and the request, on a thread of the connection's own."""
        if not self._places.acquire(blocking=False):
            self.shutdown_request(request)
            return
        sockets = [request]
        whole = threading.Timer(_WHOLE_S, _end, [sockets])
        whole.daemon = True
        whole.start()
        try:
            request.settimeout(_SILENT_S)
            secured = self._context().wrap_socket(
                request, server_side=True, do_handshake_on_connect=False
            )
            sockets.append(secured)
            secured.do_handshake()
            super().process_request_thread(secured, client_address)
        except (OSError, ValueError) as error:  # ssl's errors are OSErrors
            self.counters.refuse("connections_refused", f"{client_address[0]}: {one_line(error)}")
            self.shutdown_request(sockets[-1])
        finally:
            whole.cancel()
            self._places.release()

    def _context(self) -> ssl.SSLContext:
        """With the files as they are now: they may have been renewed."""
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.minimum_version = ssl.TLSVersion.TLSv1_3
        context.load_cert_chain(self._files.certificate, self._files.key)
        context.load_verify_locations(self._files.authority)
        context.verify_mode = ssl.CERT_OPTIONAL  # those who renew have one
        return context

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A connection that broke off is no news."""


def _end(sockets: list[socket.socket]) -> None:
    with contextlib.suppress(OSError):  # it has ended
        sockets[-1].shutdown(socket.SHUT_RDWR)


class _Handler(BaseHTTPRequestHandler):
    server: EnrolmentServer
    timeout = _SILENT_S
    server_version = "bpn"
    sys_version = ""

    def do_GET(self) -> None:
        if self.path != AUTHORITY_PATH:
            self._answer(HTTPStatus.NOT_FOUND, {"error": "there is nothing here"})
            return
        self._answer(HTTPStatus.OK, {"authority": self.server.office.authority_pem().decode()})

    def do_POST(self) -> None:
        office = self.server.office
        try:
            if self.path == MACHINES_PATH:
                admitted = office.admit(self._body())
            elif self.path == RENEWALS_PATH:
                admitted = office.renew(self._common_name(), self._body())
            else:
                self._answer(HTTPStatus.NOT_FOUND, {"error": "there is nothing here"})
                return
        except JoinRefusedError as error:
            self.server.counters.refuse("joins_refused", f"{self.client_address[0]}: {error}")
            self._answer(HTTPStatus.FORBIDDEN, {"error": str(error)})
        except InputError as error:
            self._answer(HTTPStatus.CONFLICT, {"error": str(error)})
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            self._answer(HTTPStatus.BAD_REQUEST, {"error": f"no request: {one_line(error)}"})
        except OSError as error:
            log.error("a machine cannot be admitted: %s", one_line(error))
            self._answer(HTTPStatus.INSUFFICIENT_STORAGE, {"error": one_line(error)})
        else:
            log.info("%s at %s", admitted.identity.common_name, self.client_address[0])
            self._answer(
                HTTPStatus.CREATED,
                {
                    "common_name": admitted.identity.common_name,
                    "certificate": admitted.certificate_pem.decode(),
                    "router_port": self.server.router_port,
                },
            )

    def _body(self) -> dict[str, Any]:
        length = int(self.headers.get("Content-Length", "-1"))
        if not 0 <= length <= MAX_BODY_BYTES:
            raise ValueError(f"its length must be 0 to {MAX_BODY_BYTES} bytes")
        body = json.loads(self.rfile.read(length))
        if not isinstance(body, dict):
            raise TypeError("it is no object")
        return body

    def _common_name(self) -> str:
        assert isinstance(self.connection, ssl.SSLSocket)
        shown = self.connection.getpeercert() or {}
        subject: Any = shown.get("subject", ())
        return next((v for names in subject for k, v in names if k == "commonName"), "")

    def _answer(self, status: HTTPStatus, content: dict[str, object]) -> None:
        data = json.dumps(content).encode()
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, format: str, *args: Any) -> None:
        """What matters is logged where it happens."""


def main(argv: list[str] | None = None) -> int:
    """Serves until SIGINT or SIGTERM. Exit status: 0 stopped, 2 it cannot listen there."""
    parser = argparse.ArgumentParser(prog="bpn-enrolment", description=__doc__)
    add_version_option(parser)
    parser.add_argument("folder", type=Path, help="what `bpn-certificates` made")
    parser.add_argument("--host", default="0.0.0.0", help="(default %(default)s)")  # noqa: S104
    parser.add_argument("--port", type=int, default=7448, help="(default %(default)s)")
    parser.add_argument("--router-port", type=int, default=7447, help="(default %(default)s)")
    parser.add_argument(
        "--server-name", action="append", metavar="NAME", default=[],
        help="by which machines reach this one, for invitations (default: as noted before)",
    )  # fmt: skip
    options = parser.parse_args(argv)
    set_up_logging("enrolment")
    stop = stop_on_signals()
    end_with_supervisor()
    try:
        authority_in(options.folder)
        if names := separated(options.server_name):
            Book(options.folder).place_door(names, options.port)
        address = options.host, options.port
        with EnrolmentServer(address, options.folder, options.router_port) as server, Heartbeat():
            threading.Thread(target=server.serve_forever, name="enrolment", daemon=True).start()
            log.info("machines are admitted at %s port %d", options.host, options.port)
            stop.wait()
            server.shutdown()
    except (InputError, OSError) as error:
        log.error("machines cannot be admitted: %s", one_line(error))
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
