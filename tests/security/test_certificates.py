"""Who is let in: nobody without a certificate of our authority that is good today."""

import datetime
import json
import stat
from pathlib import Path

import pytest
import zenoh
from secure_router import SecureRouter

from bpn_certificates import authority as x509
from bpn_certificates.authority import Identity, Validity
from bpn_certificates.command import main
from bpn_certificates.folders import make
from bpn_shared.bus.access import ROLES, ROUTER
from bpn_shared.bus.certificates import (
    AUTHORITY,
    CERTIFICATE,
    FOLDER_VARIABLE,
    KEY,
    CertificateError,
)
from bpn_shared.bus.session import Bus, BusError

REFUSED_AFTER_S = 1.0
DAY = Validity.of_days(1)


def yesterday() -> Validity:
    now = datetime.datetime.now(datetime.UTC)
    return Validity(now - datetime.timedelta(days=2), now - datetime.timedelta(days=1))


def test_every_role_is_let_in(router: SecureRouter) -> None:
    for role in ROLES:
        with router.open_as(role) as bus:
            assert bus.connected


def test_an_expired_certificate_is_refused(router: SecureRouter) -> None:
    router.issue("expired", x509.issue(router.authority, "edge", yesterday()))
    with pytest.raises(BusError):
        router.open_as("expired", REFUSED_AFTER_S)


def test_a_certificate_of_another_authority_is_refused(router: SecureRouter) -> None:
    other = x509.new_authority("bpn authority", DAY)  # the same name, another key
    router.issue("other", x509.issue(other, "edge", DAY))
    with pytest.raises(BusError):
        router.open_as("other", REFUSED_AFTER_S)


def test_a_role_cannot_make_certificates(router: SecureRouter) -> None:
    folder = router.certificates / "edge"
    edge = Identity.from_pem((folder / CERTIFICATE).read_bytes(), (folder / KEY).read_bytes())
    router.issue("made-by-edge", x509.issue(edge, "learner", DAY))
    with pytest.raises(BusError):
        router.open_as("made-by-edge", REFUSED_AFTER_S)


@pytest.mark.parametrize("transport", ["tls", "tcp"])
def test_who_shows_no_certificate_is_refused(router: SecureRouter, transport: str) -> None:
    authority = str(router.certificates / "edge" / AUTHORITY)
    config = {
        "mode": "client",
        "connect": {"endpoints": [router.endpoint.replace("tls", transport)], "timeout_ms": 0},
        "scouting": {"multicast": {"enabled": False}},
        "transport": {"link": {"tls": {"root_ca_certificate": authority}}},
    }
    with pytest.raises(zenoh.ZError):
        zenoh.open(zenoh.Config.from_json5(json.dumps(config)))


def test_a_router_that_another_authority_vouches_for_is_not_talked_to(
    router: SecureRouter,
) -> None:
    edge = x509.issue(router.authority, "edge", DAY)
    router.issue("deceived", edge, trusted=x509.new_authority("bpn authority", DAY))
    with pytest.raises(BusError):
        router.open_as("deceived", REFUSED_AFTER_S)


def test_a_router_with_another_name_than_its_certificate_is_not_talked_to(
    router: SecureRouter, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(FOLDER_VARIABLE, str(router.certificates / "edge"))
    with pytest.raises(BusError):  # the certificate says localhost
        Bus(router.endpoint.replace("localhost", "127.0.0.1"), deadline_s=REFUSED_AFTER_S)


def test_without_certificates_the_error_says_what_is_missing(
    router: SecureRouter, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv(FOLDER_VARIABLE, raising=False)
    with pytest.raises(CertificateError, match=FOLDER_VARIABLE):
        Bus(router.endpoint)
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    with pytest.raises(CertificateError, match=str(tmp_path / AUTHORITY)):
        Bus(router.endpoint)


Snapshot = dict[str, bytes]


def certificates(folder: Path) -> Snapshot:
    return {path.parent.name: path.read_bytes() for path in folder.glob(f"*/{CERTIFICATE}")}


def test_what_is_good_stays_and_what_is_not_is_made_anew(tmp_path: Path) -> None:
    everyone = ["authority", ROUTER, *ROLES]
    assert make(tmp_path, days=10, server_names=["router"]) == everyone
    first = certificates(tmp_path)
    assert make(tmp_path, days=10, server_names=["router"]) == []
    (tmp_path / "edge" / KEY).unlink()
    (tmp_path / "learner" / CERTIFICATE).unlink()
    (tmp_path / "learner" / CERTIFICATE).write_bytes(b"nonsense")
    assert make(tmp_path, days=10, server_names=["router", "127.0.0.1"]) == [
        ROUTER,
        "learner",
        "edge",
    ]
    second = certificates(tmp_path)
    assert {name for name in everyone if first[name] == second[name]} == {
        "authority",
        "dashboard",
        "robot_sim",
    }
    assert make(tmp_path, days=50, server_names=["router", "127.0.0.1"]) == [ROUTER, *ROLES]


def names_of(folder: Path) -> set[str]:
    certificate = Identity.from_pem(
        (folder / CERTIFICATE).read_bytes(), (folder / KEY).read_bytes()
    ).certificate
    return x509.server_names(certificate)


def test_a_router_keeps_the_names_that_it_was_given_and_another_has_its_own(tmp_path: Path) -> None:
    assert main([str(tmp_path), "--server-name", "center.example"]) == 0
    center = (tmp_path / ROUTER / CERTIFICATE).read_bytes()
    assert main([str(tmp_path)]) == 0
    assert main([str(tmp_path), "--router", "site-a", "--server-name", "a.example"]) == 0
    assert (tmp_path / ROUTER / CERTIFICATE).read_bytes() == center
    assert names_of(tmp_path / "site-a") == {"a.example"}
    assert main([str(tmp_path), "--server-name", "192.0.2.1"]) == 0
    assert names_of(tmp_path / ROUTER) == {"center.example", "192.0.2.1"}
    site_a = (tmp_path / "site-a" / CERTIFICATE).read_bytes()
    (tmp_path / "authority" / KEY).unlink()  # all certificates are made anew, those of sites too
    assert main([str(tmp_path)]) == 0
    assert (tmp_path / "site-a" / CERTIFICATE).read_bytes() != site_a
    assert names_of(tmp_path / "site-a") == {"a.example"}
    common_name = x509.NameOID.COMMON_NAME
    for folder in (ROUTER, "site-a"):  # what access control knows a router by
        subject = Identity.from_pem(
            (tmp_path / folder / CERTIFICATE).read_bytes(), (tmp_path / folder / KEY).read_bytes()
        ).certificate.subject
        assert subject.get_attributes_for_oid(common_name)[0].value == ROUTER


@pytest.mark.parametrize(
    "wrong",
    [["--router", "edge"], ["--router", "../x"], ["--router", ""], ["--days", "0"],
     ["--days", "nan"], ["--days", "1e9"]],
)  # fmt: skip
def test_wrong_options_are_named_and_make_nothing(
    wrong: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main([str(tmp_path / "certificates"), *wrong])
    assert wrong[0] in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_new_authority_makes_all_certificates_anew(tmp_path: Path) -> None:
    make(tmp_path, days=10, server_names=["router"])
    (tmp_path / "authority" / KEY).unlink()
    assert make(tmp_path, days=10, server_names=["router"]) == ["authority", ROUTER, *ROLES]


def test_keys_are_for_their_owner_alone(tmp_path: Path) -> None:
    make(tmp_path, days=10, server_names=["router"])
    for role in ("authority", ROUTER, *ROLES):
        assert stat.S_IMODE((tmp_path / role).stat().st_mode) == 0o700
        assert stat.S_IMODE((tmp_path / role / KEY).stat().st_mode) == 0o400
        if role != "authority":
            assert (tmp_path / role / AUTHORITY).read_bytes() == (
                tmp_path / "authority" / CERTIFICATE
            ).read_bytes()


def test_the_command_says_what_it_made(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path)]) == 0
    assert "authority, router, dashboard" in capsys.readouterr().out
    assert main([str(tmp_path)]) == 0
    assert capsys.readouterr().out == "all certificates are good\n"
    blocked = tmp_path / "file"
    blocked.write_text("")
    assert main([str(blocked)]) == 1
    assert str(blocked) in capsys.readouterr().err
