"""Certificates that end: renewed in time nothing stops, otherwise it is said before and after."""

import datetime
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from bpn_certificates import authority as x509
from bpn_certificates.authority import Identity, Validity
from bpn_certificates.folders import make
from bpn_shared.backoff import Backoff
from bpn_shared.bus.certificates import (
    AUTHORITY,
    CERTIFICATE,
    FOLDER_VARIABLE,
    KEY,
    CertificateFiles,
)
from bpn_shared.bus.obstacle import obstacle
from bpn_shared.bus.renewal import CertificateWatch
from bpn_shared.bus.requests import Responder
from bpn_shared.bus.router_watch import RouterWatch
from bpn_shared.bus.session import Bus
from bpn_shared.bus.x509 import facts_of
from bpn_shared.counters import Counters
from bpn_shared.runtime.ask import ask
from bpn_shared.waiting import WaitStatus

WaitFor = Callable[..., None]
LIFE_S = 24.0
KEY_OF_CONTROL = "bpn/control/learner/learner-0"  # the registry asks, a learner answers


def seconds(count: float) -> float:
    """As days."""
    return count / 86_400


def test_certificates_renewed_in_time_are_used_and_nothing_is_lost(
    tmp_path: Path, free_tcp_port: Callable[[], int], monkeypatch: pytest.MonkeyPatch,
    wait_for: WaitFor,
) -> None:  # fmt: skip
    make(tmp_path, days=seconds(LIFE_S), server_names=["localhost"])
    endpoint = f"tls/localhost:{free_tcp_port()}"
    router = subprocess.Popen(
        [
            *(sys.executable, "-m", "bpn_shared.bus.router", "--listen", endpoint),
            *("--certificates", str(tmp_path / "router")),
        ],
        stderr=subprocess.PIPE,
        text=True,
    )

    def open_as(role: str) -> Bus:
        monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / role))
        return Bus(endpoint, deadline_s=LIFE_S / 2)

    answered = 0
    try:
        with open_as("dashboard") as asking, open_as("learner") as answering:
            first_end = facts_of(tmp_path / "router" / CERTIFICATE).end
            with Responder(answering, KEY_OF_CONTROL, bytes, Counters()):

                def answers() -> bool:
                    nonlocal answered
                    answer = ask(
                        asking, KEY_OF_CONTROL, b"1", bytes, stop=threading.Event(),
                        waiting=WaitStatus(), waiting_for="an answer", on_refusal=pytest.fail,
                        timeout_s=1.0, backoff=Backoff(0.1, 0.1),
                    )  # fmt: skip
                    answered += answer == b"1"
                    return True

                def renewed() -> bool:
                    answers()
                    return "router" in make(
                        tmp_path, days=seconds(LIFE_S), server_names=["localhost"]
                    )

                wait_for(renewed, "the certificates to be renewed", LIFE_S)
                wait_for(
                    lambda: answers() and datetime.datetime.now(datetime.UTC) > first_end,
                    "the first certificates to end",
                    LIFE_S,
                )
                before = answered
                wait_for(lambda: answers() and answered > before + 20, "answers afterwards")
            edge = CertificateFiles.in_folder(tmp_path / "edge")
            assert obstacle(endpoint, edge) == ""  # a new session is let in
            assert asking.connected
            assert answering.connected
    finally:
        router.terminate()
        _, said = router.communicate(timeout=20)
    assert "there are new certificates" in said
    assert " ERROR " not in said


def test_a_router_whose_certificates_are_not_renewed_is_not_ready_and_says_why(
    tmp_path: Path, free_tcp_port: Callable[[], int], monkeypatch: pytest.MonkeyPatch,
    wait_for: WaitFor, caplog: pytest.LogCaptureFixture,
) -> None:  # fmt: skip
    make(tmp_path, days=seconds(15), server_names=["localhost"])
    make(tmp_path / "lasting", days=1, server_names=["localhost"])
    endpoint = f"tls/localhost:{free_tcp_port()}"
    heartbeat = tmp_path / "heartbeat"
    monkeypatch.setenv("BPN_HEARTBEAT", str(heartbeat))
    said = tmp_path / "said"
    with said.open("w") as log:
        router = subprocess.Popen(
            [
                *(sys.executable, "-m", "bpn_shared.bus.router", "--listen", endpoint),
                *("--certificates", str(tmp_path / "router")),
            ],
            stderr=log,
        )
    monkeypatch.delenv("BPN_HEARTBEAT")
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "edge"))
    ready = heartbeat.with_name("heartbeat.ready")
    try:
        with Bus(endpoint, deadline_s=15.0) as bus:
            wait_for(ready.exists, "it to be ready")
            waiting = WaitStatus()
            with RouterWatch(bus, waiting, Counters(), period_s=0.1, say_after_s=0.5):
                wait_for(lambda: "expired" in (waiting.snapshot()[0] or ""), "the reason")
        assert "our certificate" in caplog.text

        def stays_as_it_is() -> bool:
            last = ready.read_text()
            threading.Event().wait(2.0)  # two of its periods
            return ready.read_text() == last

        wait_for(stays_as_it_is, "it to be no longer ready", 30)
        assert heartbeat.read_text() > ready.read_text()
        expired = f"ERROR certificate {tmp_path / 'router' / CERTIFICATE} expired 20"
        wait_for(lambda: expired in said.read_text(), "the router to say why")
    finally:
        router.terminate()
        router.wait(20)


def test_the_end_is_announced_once_a_day_and_from_then_on_once_an_hour(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    authority = x509.new_authority("bpn authority", Validity.of_days(3650))
    now = datetime.datetime.now(datetime.UTC)
    clock_s = 0.0

    def write(days_left: float) -> None:
        validity = Validity(
            now - datetime.timedelta(days=300), now + datetime.timedelta(days=days_left)
        )
        _write(tmp_path, x509.issue(authority, "edge", validity), authority)

    write(31)
    watch = CertificateWatch(CertificateFiles.in_folder(tmp_path), lambda: clock_s)

    def days_of_warnings(days: int) -> list[str]:
        nonlocal clock_s
        caplog.clear()
        for _ in range(days * 24 * 6):
            clock_s += 600
            watch.warn()
        return [r.levelname for r in caplog.records if r.name == CertificateWatch.__module__]

    assert days_of_warnings(3) == []
    write(29.9)
    assert days_of_warnings(3) == ["WARNING"] * 3
    assert "ends in 29.9 days" in caplog.text
    write(-1)
    assert days_of_warnings(1) == ["ERROR"] * 24
    write(365)
    assert watch.renewed()
    assert not watch.renewed()
    assert days_of_warnings(3) == []


def test_the_authoritys_end_is_announced_too(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    now = datetime.datetime.now(datetime.UTC)

    def validity(days_ago: float, days_left: float) -> Validity:
        day = datetime.timedelta(days=1)
        return Validity(now - days_ago * day, now + days_left * day)

    authority = x509.new_authority("bpn authority", validity(3630, 20))
    for own_days in (300, 5):  # it ends later; it is renewed all the time
        caplog.clear()
        own = x509.issue(authority, "edge", validity(own_days / 10, own_days))
        _write(tmp_path, own, authority)
        watch = CertificateWatch(CertificateFiles.in_folder(tmp_path))
        watch.warn()
        assert f"{AUTHORITY} ends in 20.0 days" in caplog.text
        assert watch.life is not None
        assert 19.9 < watch.life.left(now) / datetime.timedelta(days=1) <= 20
        assert watch.life.is_near_end(now)


def test_half_a_renewal_and_a_wrong_one_are_left_alone(tmp_path: Path) -> None:
    authority = x509.new_authority("bpn authority", Validity.of_days(10))
    first, second = (x509.issue(authority, "edge", Validity.of_days(1)) for _ in range(2))
    _write(tmp_path, first, authority)
    watch = CertificateWatch(CertificateFiles.in_folder(tmp_path))
    assert not watch.renewed()
    (tmp_path / KEY).write_bytes(second.key_pem())  # the certificate will follow
    assert not watch.renewed()
    (tmp_path / CERTIFICATE).unlink()
    assert not watch.renewed()
    (tmp_path / CERTIFICATE).write_bytes(second.certificate_pem())
    assert watch.renewed()


def _write(folder: Path, identity: Identity, authority: Identity) -> None:
    files = CertificateFiles.in_folder(folder)
    files.authority.write_bytes(authority.certificate_pem())
    files.certificate.write_bytes(identity.certificate_pem())
    files.key.write_bytes(identity.key_pem())
