"""A machine and the door where it is admitted: real TLS, real files."""

import http.client
import json
import socket
import ssl
import threading
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.serialization import Encoding

from bpn.joined import Renewal
from bpn_certificates.authority import Identity as Pair
from bpn_certificates.authority import Validity, certify, new_key, signing_request
from bpn_certificates.book import Book
from bpn_certificates.enrolment import MAX_BODY_BYTES, EnrolmentServer
from bpn_certificates.folders import make
from bpn_certificates.invitations import invite
from bpn_certificates.joining import Machine, UnreachableError, join
from bpn_certificates.token import Token
from bpn_shared.bus.admitted import read_admitted
from bpn_shared.bus.certificates import CERTIFICATE, KEY, CertificateFiles
from bpn_shared.bus.identity import Identity
from bpn_shared.bus.obstacle import own_obstacle
from bpn_shared.bus.x509 import facts_of
from bpn_shared.errors import InputError


class Office:
    """An authority in a folder, and its door."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        make(folder, days=10, server_names=["localhost"])
        self.server = EnrolmentServer(("127.0.0.1", 0), folder, router_port=7447)
        self.port = self.server.server_address[1]
        Book(folder).place_door(["localhost"], self.port)
        threading.Thread(target=self.server.serve_forever, args=(0.05,), daemon=True).start()

    def token(self, **more: str) -> Token:
        return Token.parse(invite(self.folder, **more))

    def close(self) -> None:
        self.server.shutdown()
        self.server.server_close()

    def post(
        self, path: str, body: bytes, headers: dict[str, str] | None = None
    ) -> tuple[int, str]:
        anyone = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        anyone.check_hostname, anyone.verify_mode = False, ssl.CERT_NONE
        connection = http.client.HTTPSConnection("localhost", self.port, timeout=10, context=anyone)
        try:
            connection.request("POST", path, body, headers or {})
            answer = connection.getresponse()
            return answer.status, json.loads(answer.read())["error"]
        finally:
            connection.close()


@pytest.fixture
def office(tmp_path: Path) -> Iterator[Office]:
    opened = Office(tmp_path / "office")
    yield opened
    opened.close()


def refusal(attempt: Callable[[], object]) -> str:
    with pytest.raises(InputError) as caught:
        attempt()
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_machine_gets_a_certificate_for_its_key_and_its_router_rights(
    office: Office, tmp_path: Path
) -> None:
    machine = join(office.token(site="lab-b"), "pi-7", tmp_path / "pi")
    assert machine.identity == Identity.of("router", "lab-b", "pi-7")
    assert machine.endpoint == "tls/localhost:7447"
    assert own_obstacle(machine.files) == ""
    assert facts_of(machine.files.certificate).common_name == "router@lab-b.pi-7"
    assert facts_of(machine.files.certificate).server_names == frozenset()
    assert read_admitted(office.folder / "router") == (machine.identity,)
    assert Machine.load(tmp_path / "pi") == machine
    keys = list(office.folder.rglob(KEY))
    assert machine.files.key.read_bytes() not in [path.read_bytes() for path in keys]


def test_the_same_command_again_goes_on_and_nobody_elses_does(
    office: Office, tmp_path: Path
) -> None:
    token = office.token()
    machine = join(token, "pi-7", tmp_path / "pi")
    assert join(token, "pi-7", tmp_path / "pi") == machine
    said = refusal(lambda: join(token, "pi-8", tmp_path / "other"))
    assert "the token was used at" in said
    assert "pi-7" in said
    assert len(Book(office.folder).machines()) == 1


def test_an_answer_that_was_lost_is_had_again(office: Office, tmp_path: Path) -> None:
    token, state = office.token(), tmp_path / "pi"
    machine = join(token, "pi-7", state)
    (state / "machine.json").unlink()  # as if it had died before it was told
    (state / "new-key.pem").write_bytes(machine.files.key.read_bytes())
    assert join(token, "pi-7", state).identity == machine.identity
    assert len(Book(office.folder).machines()) == 1


def test_who_has_another_authority_than_the_tokens_is_told_nothing(
    office: Office, tmp_path: Path
) -> None:
    other = Office(tmp_path / "other")
    try:
        forged = office.token()._replace(port=other.port)
        assert "another authority" in refusal(lambda: join(forged, "pi-7", tmp_path / "pi"))
        assert not other.server.counters.snapshot()
        assert not (tmp_path / "pi" / "machine.json").exists()
    finally:
        other.close()


@pytest.mark.parametrize("told", [None, b"nothing of the kind"])
def test_what_else_answers_at_an_address_of_the_tokens_keeps_nobody_from_the_next(
    office: Office, tmp_path: Path, told: bytes | None
) -> None:
    """An address may be another machine's too, as those of containers are."""
    make(tmp_path / "other", days=10, server_names=["127.0.0.2"])
    with EnrolmentServer(("127.0.0.2", office.port), tmp_path / "other", 7447) as other:
        if told is not None:
            other.office.authority_pem = lambda: told  # type: ignore[method-assign]
        threading.Thread(target=other.serve_forever, args=(0.05,), daemon=True).start()
        try:
            token = office.token()._replace(hosts=("127.0.0.2", "localhost"))
            assert join(token, "pi-7", tmp_path / "pi").host == "localhost"
            alone = office.token()._replace(hosts=("127.0.0.2",))
            assert "127.0.0.2 " in refusal(lambda: join(alone, "pi-8", tmp_path / "pi-8"))
        finally:
            other.shutdown()


def test_wrong_expired_and_revoked_tokens_are_refused_in_one_line(
    office: Office, tmp_path: Path
) -> None:
    wrong = office.token()._replace(secret=bytes(16))
    assert "not known here" in refusal(lambda: join(wrong, "pi-7", tmp_path / "pi"))
    expired = office.token()
    path = office.folder / "authority" / "joining.json"
    content = json.loads(path.read_text())
    content["invitations"][-1]["ends_unix_s"] = time.time() - 60
    path.write_text(json.dumps(content))
    assert "expired at" in refusal(lambda: join(expired, "pi-7", tmp_path / "pi"))
    revoked = office.token()
    Book(office.folder).revoke(Book(office.folder).invitations()[-1].id)
    assert "revoked" in refusal(lambda: join(revoked, "pi-7", tmp_path / "pi"))
    assert read_admitted(office.folder / "router") == ()


def test_nobody_there_is_told_with_the_place(tmp_path: Path, office: Office) -> None:
    token = office.token()._replace(hosts=("127.0.0.1", "localhost"), port=9)
    with pytest.raises(UnreachableError) as caught:
        join(token, "pi-7", tmp_path / "pi")
    assert "127.0.0.1 port 9" in str(caught.value)
    assert "localhost port 9" in str(caught.value)


def test_a_machine_renews_its_certificate_until_it_is_removed(
    office: Office, tmp_path: Path
) -> None:
    machine = join(office.token(), "pi-7", tmp_path / "pi")
    before, key = machine.files.certificate.read_bytes(), machine.files.key.read_bytes()
    machine.renew()
    assert machine.files.certificate.read_bytes() != before
    assert machine.files.key.read_bytes() == key
    assert own_obstacle(machine.files) == ""
    Book(office.folder).remove("pi-7")
    assert "is not admitted" in refusal(machine.renew)


def test_a_roles_certificate_renews_no_machines(office: Office, tmp_path: Path) -> None:
    machine = join(office.token(), "pi-7", tmp_path / "pi")
    for name in (CERTIFICATE, KEY):
        path = tmp_path / "pi" / "certificates" / name
        path.unlink()
        path.write_bytes((office.folder / "edge" / name).read_bytes())
    assert "edge is not admitted" in refusal(machine.renew)
    request = signing_request(new_key()).decode()
    body = json.dumps({"request": request}).encode()
    assert office.post("/renewals", body) == (403, "who shows no certificate is not admitted")


@pytest.mark.parametrize(
    "body",
    [b"", b"{", b"[]", b"null", b"{}", b"[" * 5000, b'{"request": 1, "secret": "", "name": "x"}',
     b'{"request": "x", "secret": "", "name": "x"}', bytes(MAX_BODY_BYTES + 1)],
)  # fmt: skip
def test_what_is_no_request_is_refused_and_nothing_happens(office: Office, body: bytes) -> None:
    for path in ("/machines", "/renewals"):
        status, said = office.post(path, body)
        assert status in (400, 403), said
    assert office.post("/else", b"{}")[0] == 404
    assert not Book(office.folder).machines()


def test_a_name_that_cannot_be_one_is_refused(office: Office, tmp_path: Path) -> None:
    for name in ("../x", "a b", "", "x" * 25, "A"):
        assert "name = " in refusal(lambda name=name: join(office.token(), name, tmp_path / "pi"))
    assert not Book(office.folder).machines()


def test_a_request_of_a_key_that_its_sender_has_not_is_refused(office: Office) -> None:
    request = signing_request(new_key())
    damaged = request[:200] + (b"A" if request[200:201] != b"A" else b"B") + request[201:]
    body = {"request": damaged.decode(), "secret": "AAAA", "name": "pi-7"}
    status, said = office.post("/machines", json.dumps(body).encode())
    assert status == 400
    assert "no request" in said


def test_connections_that_say_nothing_keep_nobody_out(office: Office, tmp_path: Path) -> None:
    silent = [socket.create_connection(("127.0.0.1", office.port)) for _ in range(20)]
    try:
        assert join(office.token(), "pi-7", tmp_path / "pi").identity.machine == "pi-7"
    finally:
        for connection in silent:
            connection.close()


def test_the_authority_is_for_machines_what_it_is_for_roles(office: Office, tmp_path: Path) -> None:
    machine = join(office.token(), "pi-7", tmp_path / "pi")
    edge = CertificateFiles.in_folder(office.folder / "edge")
    assert machine.files.authority.read_bytes() == edge.authority.read_bytes()
    Pair.from_pem(machine.files.certificate.read_bytes(), machine.files.key.read_bytes())


def test_a_certificate_near_its_end_is_renewed_by_the_machine_itself(
    office: Office, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    machine = join(office.token(), "pi-7", tmp_path / "pi")
    before = machine.files.certificate.read_bytes()
    hours_s = Renewal(machine).look()
    assert machine.files.certificate.read_bytes() == before  # it is good for long
    folder = office.folder / "authority"
    authority = Pair.from_pem((folder / CERTIFICATE).read_bytes(), (folder / KEY).read_bytes())
    key = Pair.from_pem(before, machine.files.key.read_bytes()).key.public_key()
    start = datetime.now(UTC) - timedelta(days=9)
    life = Validity(start, start + timedelta(days=10))
    ending = certify(authority, machine.identity.common_name, key, life)
    machine.files.certificate.unlink()
    machine.files.certificate.write_bytes(ending.public_bytes(Encoding.PEM))
    Renewal(machine).look()
    assert facts_of(machine.files.certificate).life.left(datetime.now(UTC)) > timedelta(days=300)
    assert own_obstacle(machine.files) == ""
    machine.files.certificate.unlink()
    machine.files.certificate.write_bytes(ending.public_bytes(Encoding.PEM))
    Book(office.folder).remove("pi-7")
    assert Renewal(machine).look() < hours_s
    assert "cannot be renewed" in caplog.text
    assert "is not admitted" in caplog.text


def test_a_damaged_certificate_ends_nobody(
    office: Office, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    machine = join(office.token(), "pi-7", tmp_path / "pi")
    machine.files.certificate.unlink()
    machine.files.certificate.write_bytes(b"no certificate")
    assert Renewal(machine).look() > 0
    assert "cannot be renewed" in caplog.text
