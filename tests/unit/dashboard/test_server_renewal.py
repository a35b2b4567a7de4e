"""The certificate of the pages' address is shown anew when its files are renewed; a wrong pair does no harm."""

import ssl
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from bpn_certificates.authority import Identity, Validity, issue, new_authority
from bpn_dashboard import server
from bpn_dashboard.access.connections import Connections
from bpn_dashboard.server import Server, listen
from bpn_shared.counters import Counters
from bpn_shared.runs.files import write_atomically

MISMATCH = "key values mismatch"
DAY = Validity.of_days(1)
AUTHORITY = new_authority("pages", DAY)


async def nothing(_scope: object, _receive: object, _send: object) -> None:
    """Answers nobody: the handshake is all that is looked at."""


def write(folder: Path, identity: Identity, *, key: Identity | None = None) -> None:
    write_atomically(folder / "certificate.pem", identity.certificate_pem())
    write_atomically(folder / "key.pem", (key or identity).key_pem())


@contextmanager
def serving(folder: Path) -> Iterator[Callable[[], str]]:
    """A server with the files of a folder; asks what it shows."""
    listener, stop = listen("127.0.0.1", 0), threading.Event()
    listener.connections = Connections(Counters())
    running = Server(nothing, listener, folder / "certificate.pem", folder / "key.pem")
    running.config.lifespan = "off"
    thread = threading.Thread(target=running.serve_until, args=[stop], daemon=True)
    thread.start()
    try:
        yield lambda: ssl.get_server_certificate(listener.getsockname(), timeout=20.0)
    finally:
        stop.set()
        thread.join(20.0)
        listener.close()


def test_renewed_files_are_shown_and_half_a_renewal_is_not(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    wait_for: Callable[..., None],
) -> None:
    monkeypatch.setattr(server, "_RENEWAL_S", 0.05)
    first, second = (issue(AUTHORITY, "pages", DAY, server_names=["localhost"]) for _ in range(2))
    pem = {name: each.certificate_pem().decode() for name, each in (("1", first), ("2", second))}
    write(tmp_path, first)
    with serving(tmp_path) as shown:
        assert shown() == pem["1"]
        write(tmp_path, second, key=first)
        wait_for(lambda: MISMATCH in caplog.text, "the wrong pair to be seen")
        assert shown() == pem["1"]
        handshakes = [shown() for _ in range(20)]  # longer than some looks
        assert set(handshakes) == {pem["1"]}
        assert caplog.text.count(MISMATCH) == 1
        (tmp_path / "key.pem").unlink()
        assert shown() == pem["1"]
        write(tmp_path, second)
        wait_for(lambda: shown() == pem["2"], "the new certificate")
