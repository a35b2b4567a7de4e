"""Each mistake with certificates is told as what it is, at once, and without the places of Zenoh's source code."""

import contextlib
import datetime
import logging
import re
import socket
import ssl
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.serialization import Encoding
from hypothesis import given
from hypothesis import strategies as st
from secure_router import SecureRouter

from bpn_certificates import authority as x509
from bpn_certificates.authority import Validity
from bpn_certificates.folders import make
from bpn_shared.bus.certificates import (
    AUTHORITY,
    CERTIFICATE,
    FOLDER_VARIABLE,
    KEY,
    CertificateFiles,
)
from bpn_shared.bus.obstacle import obstacle, plain, router_certificate
from bpn_shared.bus.session import Bus, BusError
from bpn_shared.bus.x509 import Life, facts, facts_of

DAY = Validity.of_days(1)
DAY_LONG = datetime.timedelta(days=1)
AUTHORITY_IDENTITY = x509.new_authority("bpn authority", DAY)
ROUTER_DER = x509.issue(
    AUTHORITY_IDENTITY, "router", DAY, server_names=["a.example", "::1"]
).certificate.public_bytes(Encoding.DER)


def ago(days: float) -> Validity:
    now = datetime.datetime.now(datetime.UTC)
    return Validity(now - datetime.timedelta(days=days + 1), now - datetime.timedelta(days=days))


def folder_of(router: SecureRouter, mistake: str) -> Path:
    """A folder with certificates that are not accepted, for one reason."""
    ours = router.authority
    other = x509.new_authority("bpn authority", DAY)  # the same name, another key
    if mistake == "expired":
        return router.issue(mistake, x509.issue(ours, "edge", ago(1)))
    if mistake == "not-yet":
        return router.issue(mistake, x509.issue(ours, "edge", ago(-3)))
    if mistake == "other-authority":
        return router.issue(mistake, x509.issue(other, "edge", DAY))
    if mistake == "deceived":
        return router.issue(mistake, x509.issue(ours, "edge", DAY), trusted=other)
    edge = x509.issue(ours, "edge", DAY)
    folder = router.issue(mistake, edge)
    if mistake == "other-key":
        (folder / KEY).write_bytes(x509.issue(ours, "edge", DAY).key_pem())
    if mistake == "damaged":
        (folder / CERTIFICATE).write_bytes(edge.certificate_pem()[:200])
    return folder


REASONS = {
    "expired": r"our certificate \S+ \(edge\) expired 20\d\d-\d\d-\d\d \d\d:\d\d:\d\d UTC",
    "not-yet": r"our certificate \S+ \(edge\) is not good before 20.* UTC: see the clock",
    "other-authority": "the router refuses us",
    "deceived": "the router's certificate is of another authority",
    "other-key": r"key.pem is not the key of \S+certificate.pem",
    "damaged": r"certificate.pem holds no certificate",
}


@pytest.mark.parametrize("mistake", REASONS)
def test_a_mistake_with_certificates_is_named(
    router: SecureRouter, mistake: str, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    folder_of(router, mistake)
    begin_s = time.monotonic()
    with pytest.raises(BusError, match=REASONS[mistake]) as error:
        router.open_as(mistake, 2.0)
    assert ".rs:" not in str(error.value)
    assert "bpn-router" not in str(error.value)  # there is one
    said = [r for r in caplog.records if "waiting for the Zenoh router" in r.message]
    assert len(said) == 1
    assert re.search(REASONS[mistake], said[0].message)
    assert time.monotonic() - begin_s < 20


def test_a_name_that_is_not_in_the_certificate_is_named(
    router: SecureRouter, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(FOLDER_VARIABLE, str(router.certificates / "edge"))
    with pytest.raises(BusError, match=r"certificate is not for the name 127\.0\.0\.1"):
        Bus(router.endpoint.replace("localhost", "127.0.0.1"), deadline_s=1.0)


def test_who_is_let_in_meets_no_obstacle(router: SecureRouter) -> None:
    folder = CertificateFiles.in_folder(router.certificates / "edge")
    assert obstacle(router.endpoint, folder) == ""
    elsewhere = router.endpoint.replace("localhost", "127.0.0.1")
    assert obstacle(elsewhere, folder)
    assert obstacle(elsewhere, folder, any_name=True) == ""


def test_an_expired_router_is_named_with_its_date(router: SecureRouter, tmp_path: Path) -> None:
    # Python's own TLS server in the router's place: what is tested is what we say of a certificate
    expired = x509.issue(router.authority, "router", ago(2), server_names=["localhost"])
    (tmp_path / CERTIFICATE).write_bytes(expired.certificate_pem())
    (tmp_path / KEY).write_bytes(expired.key_pem())
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(tmp_path / CERTIFICATE, tmp_path / KEY)
    with serving(context) as port:
        said = obstacle(
            f"tls/localhost:{port}", CertificateFiles.in_folder(router.certificates / "edge")
        )
    end = f"{expired.certificate.not_valid_after_utc:%Y-%m-%d %H:%M:%S}"
    assert said == f"the router's certificate (router) expired {end} UTC"


@contextlib.contextmanager
def serving(context: ssl.SSLContext) -> Iterator[int]:
    listener = socket.create_server(("localhost", 0))

    def accept() -> None:
        with contextlib.suppress(OSError):
            while True:
                connection, _ = listener.accept()
                with contextlib.suppress(OSError):
                    context.wrap_socket(connection, server_side=True).close()

    threading.Thread(target=accept, daemon=True).start()
    try:
        yield listener.getsockname()[1]
    finally:
        listener.close()


def test_something_that_speaks_no_tls_is_named(router: SecureRouter, endpoint: str) -> None:
    port = endpoint.rpartition(":")[2]
    said = obstacle(
        f"tls/127.0.0.1:{port}", CertificateFiles.in_folder(router.certificates / "edge")
    )
    assert "TLS" in said


@given(
    names=st.sets(
        st.one_of(
            st.from_regex(r"[a-z]([a-z0-9-]{0,20}[a-z0-9])?(\.[a-z]{1,10}){0,3}", fullmatch=True),
            st.ip_addresses().map(str),
        ),
        max_size=12,
    )
)
def test_server_names_are_read_as_they_were_written(names: set[str]) -> None:
    router = x509.issue(AUTHORITY_IDENTITY, "router", DAY, server_names=sorted(names))
    read = facts(router.certificate.public_bytes(Encoding.DER))
    assert read.server_names == names
    assert read.common_name == "router"


@given(
    days=st.floats(0.01, 5000.0),
    name=st.text(st.characters(min_codepoint=32, max_codepoint=0x2FF), min_size=1, max_size=40),
)
def test_dates_and_names_are_read_as_they_were_written(days: float, name: str) -> None:
    identity = x509.new_authority(name, Validity.of_days(days))
    read = facts(identity.certificate.public_bytes(Encoding.DER))
    assert read.common_name == name
    assert read.start == identity.certificate.not_valid_before_utc
    assert read.end == identity.certificate.not_valid_after_utc


@given(st.integers(0, len(ROUTER_DER) - 1))
def test_a_certificate_that_is_cut_off_is_none(length: int) -> None:
    with pytest.raises(ValueError, match="not a certificate"):
        facts(ROUTER_DER[:length])


@given(st.data())
def test_damaged_certificates_are_refused_or_read_and_nothing_else(data: st.DataObject) -> None:
    der = bytearray(ROUTER_DER)
    for _ in range(data.draw(st.integers(1, 4))):
        der[data.draw(st.integers(0, len(der) - 1))] = data.draw(st.integers(0, 255))
    with contextlib.suppress(ValueError):
        read = facts(bytes(der))
        assert {read.start.tzinfo, read.end.tzinfo} == {datetime.UTC}


def test_the_life_of_a_certificate(tmp_path: Path) -> None:
    make(tmp_path, days=3, server_names=["router"])

    def days_left(file: str) -> float:
        return (
            facts_of(tmp_path / "edge" / file).life.left(datetime.datetime.now(datetime.UTC))
            / DAY_LONG
        )

    assert 2.99 < days_left(CERTIFICATE) <= 3
    assert 3649 < days_left(AUTHORITY) <= 3650
    with pytest.raises(ValueError, match="holds no certificate"):
        days_left(KEY)


@given(st.integers(1, 4000), st.floats(-10.0, 4000.0))
def test_the_end_is_near_from_thirty_days_on_and_for_the_last_quarter_of_a_short_life(
    life_days: int, left_days: float
) -> None:
    now = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)
    end = now + left_days * DAY_LONG
    near = (end - now) / DAY_LONG < min(30, life_days / 4)
    assert Life(end - life_days * DAY_LONG, end).is_near_end(now) == near


@pytest.mark.parametrize(
    "said",
    [
        "no link! at /root/.cargo/git/checkouts/zenoh-9c5/cc8/zenoh/src/net/orchestrator.rs:447.",
        "no link! [a at /root/x/src/tcp.rs:61.] at /root/x/src/unicast.rs:338.",
    ],
)
def test_places_in_source_code_are_left_out(said: str) -> None:
    assert plain(RuntimeError(said)) in ("no link!", "no link! [a]")


def test_what_a_router_shows_can_be_looked_at_without_being_let_in(
    router: SecureRouter, free_tcp_endpoint: str
) -> None:
    shown = router_certificate(router.endpoint)
    assert shown == facts_of(router.certificates / "router" / CERTIFICATE)
    nobody = free_tcp_endpoint.replace("tcp/", "tls/")
    assert [router_certificate(e) for e in (nobody, "tls/[::1:1", "tcp/127.0.0.1:1", "")] == [
        None
    ] * 4
