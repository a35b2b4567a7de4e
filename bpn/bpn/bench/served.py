"""A dashboard in a process of its own, behind a router, to be measured."""

import contextlib
import json
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import httpx
import psutil
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from bpn.supervisor import Service, Supervisor
from bpn_dashboard.hub.websocket import PATH
from bpn_dashboard.state_lock import ADDRESS_FILE

_START_S = 300.0
_REQUEST_S = 60.0


class Served:
    """A dashboard that answers.

    Attributes:
        url: where.
        http: a client with an operator's token.
        process: the dashboard's.
    """

    def __init__(self, address: dict[str, Any]) -> None:
        self.url = str(address["url"])
        self.process = psutil.Process(int(address["pid"]))
        self._authorization = {"Authorization": f"Bearer {address['token']}"}
        self.http = httpx.Client(base_url=self.url, headers=self._authorization, timeout=_REQUEST_S)

    def link(self) -> str:
        """An address that logs a browser in, once."""
        answer = self.http.post("/api/v1/links", json={"role": "operator"})
        return f"{self.url}/#token={answer.raise_for_status().json()['token']}"

    @contextlib.contextmanager
    def live(self, **options: Any) -> Iterator[ClientConnection]:
        """A client of the live view that was made welcome.

        Raises:
            ConnectionClosed: it was sent away.
        """
        url = self.url.replace("http", "ws", 1) + PATH
        with connect(
            url, compression=None, additional_headers=self._authorization, **options
        ) as connection:
            connection.send(json.dumps({"op": "hello", "proto": 1}))
            connection.recv(timeout=_REQUEST_S)
            yield connection

    @property
    def host_and_port(self) -> tuple[str, int]:
        host, _, port = self.url.rpartition("/")[2].rpartition(":")
        return host, int(port)


@contextlib.contextmanager
def serving(runs_dir: Path, endpoint: str, services: Sequence[Service]) -> Iterator[Served]:
    """A dashboard on these runs beside the services, once it has indexed the runs and serves workers.

    Args:
        endpoint: of the router, which is one of the services.
    """
    dashboard = Service(
        "dashboard",
        ["bpn_dashboard", "--runs-dir", str(runs_dir), "--connect", endpoint, "--port", "0"],
    )
    supervisor = Supervisor([*services, dashboard], runs_dir / ".logs")
    try:
        supervisor.start()
        yield _when_ready(runs_dir / ADDRESS_FILE)
    finally:
        supervisor.stop()


def router(endpoint: str) -> Service:
    """A router that listens there."""
    return Service("router", ["bpn_shared.bus.router", "--listen", endpoint])


def _when_ready(address_file: Path) -> Served:
    deadline_s = time.monotonic() + _START_S
    while time.monotonic() < deadline_s:
        with contextlib.suppress(OSError, ValueError, httpx.HTTPError, ConnectionClosed):
            served = Served(json.loads(address_file.read_bytes()))
            served.http.get("/readyz").raise_for_status()
            with served.live():
                return served
        time.sleep(0.1)
    raise TimeoutError(f"the dashboard was not ready within {_START_S:.0f} s")
