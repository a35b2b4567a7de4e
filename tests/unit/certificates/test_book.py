"""Invitations are good once and for a time; machines until they are removed."""

import fcntl
import json
import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from bpn_certificates import book as book_module
from bpn_certificates.book import Book, JoinRefusedError
from bpn_certificates.folders import AUTHORITY_FOLDER, make
from bpn_shared.bus.admitted import read_admitted
from bpn_shared.bus.identity import Identity
from bpn_shared.errors import InputError

LIFETIME_S = 60.0


class Desk:
    """A book at a time that the test sets."""

    def __init__(self, folder: Path) -> None:
        self.now_s, self.signed = 1e9, 0
        self.folder, self.book = folder, Book(folder, lambda: self.now_s)

    def redeem(self, secret: bytes, name: str = "pi-7", key: str = "k") -> Identity:
        def sign(_identity: Identity) -> bytes:
            self.signed += 1
            return b"certificate"

        return self.book.redeem(secret, name, key, sign)[0]

    def events(self) -> list[str]:
        lines = (self.folder / AUTHORITY_FOLDER / "audit.jsonl").read_text().splitlines()
        return [json.loads(line)["event"] for line in lines]


@pytest.fixture
def desk(tmp_path: Path) -> Desk:
    make(tmp_path, days=1, server_names=["localhost"])
    return Desk(tmp_path)


def refusal(attempt: Callable[[], object]) -> str:
    with pytest.raises(JoinRefusedError) as caught:
        attempt()
    return str(caught.value)


def test_a_secret_is_good_once(desk: Desk) -> None:
    secret = desk.book.invite(None, None, LIFETIME_S)
    machine = Identity.of("router", "pi-7", "pi-7")
    assert desk.redeem(secret) == machine
    assert read_admitted(desk.folder / "router") == (machine,)
    assert "was used at 2001-09-09" in refusal(lambda: desk.redeem(secret, "pi-8", "other"))
    assert desk.signed == 1
    assert desk.events() == ["invited", "joined"]


def test_whose_answer_was_lost_asks_again_with_its_key(desk: Desk) -> None:
    secret = desk.book.invite("pi-7", "lab-b", LIFETIME_S)
    first = desk.redeem(secret, "whatever")
    assert desk.redeem(secret, "whatever") == first == Identity.of("router", "lab-b", "pi-7")
    assert len(desk.book.machines()) == 1
    desk.book.remove("pi-7")
    assert "was removed" in refusal(lambda: desk.redeem(secret))


def test_a_secret_ends_with_its_time_with_its_revocation_and_is_not_guessed(desk: Desk) -> None:
    secret = desk.book.invite(None, None, LIFETIME_S)
    assert "not known" in refusal(lambda: desk.redeem(bytes(16)))
    desk.now_s += LIFETIME_S + 1
    assert "expired at 2001-09-09" in refusal(lambda: desk.redeem(secret))
    other = desk.book.invite(None, None, LIFETIME_S)
    (open_one,) = desk.book.invitations()
    desk.book.revoke(open_one.id)
    assert "revoked" in refusal(lambda: desk.redeem(other))
    with pytest.raises(InputError, match="no open invitation"):
        desk.book.revoke(open_one.id)
    assert not desk.signed
    assert not desk.book.machines()


def test_the_file_holds_no_secret_and_is_for_its_owner(desk: Desk) -> None:
    secret = desk.book.invite(None, None, LIFETIME_S)
    for path in (desk.folder / AUTHORITY_FOLDER).iterdir():
        assert secret not in path.read_bytes()
        assert secret.hex() not in path.read_text()
        if path.suffix in (".json", ".jsonl"):
            assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_a_machines_name_is_its_own_for_ever(desk: Desk) -> None:
    desk.redeem(desk.book.invite(None, None, LIFETIME_S))
    again = desk.book.invite(None, None, LIFETIME_S)
    assert "has joined already" in refusal(lambda: desk.redeem(again))
    assert desk.book.remove("pi-7") == ["router@pi-7.pi-7"]
    assert read_admitted(desk.folder / "router") == ()
    assert "was removed" in refusal(lambda: desk.redeem(again))
    assert desk.redeem(again, "pi-8").machine == "pi-8"  # a refusal uses nothing up
    with pytest.raises(InputError, match="choose another name"):
        desk.book.invite("pi-7", None, LIFETIME_S)
    with pytest.raises(InputError, match="no machine"):
        desk.book.remove("pi-7")


def test_what_cannot_be_signed_uses_nothing_up(desk: Desk) -> None:
    secret = desk.book.invite(None, None, LIFETIME_S)

    def fail(_identity: Identity) -> bytes:
        raise OSError("the disk is full")

    with pytest.raises(OSError, match="full"):
        desk.book.redeem(secret, "pi-7", "k", fail)
    assert desk.redeem(secret).machine == "pi-7"


def test_a_damaged_book_is_named(desk: Desk) -> None:
    desk.book.invite(None, None, LIFETIME_S)
    path = desk.folder / AUTHORITY_FOLDER / "joining.json"
    path.write_text(path.read_text()[:-3])
    with pytest.raises(InputError, match="is damaged"):
        desk.book.invite(None, None, LIFETIME_S)


def test_a_second_router_is_told_of_the_machines_too(desk: Desk) -> None:
    desk.redeem(desk.book.invite(None, None, LIFETIME_S))
    make(desk.folder, days=1, server_names=["center.example"], router="center-2")
    desk.book.tell_routers()
    assert read_admitted(desk.folder / "center-2") == read_admitted(desk.folder / "router") != ()


def test_invitations_that_are_over_keep_nobody_from_being_invited(
    desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`bpn up` makes one at every start; one that is over cannot be revoked."""
    monkeypatch.setattr(book_module, "MAX_INVITATIONS", 3)
    desk.redeem(desk.book.invite(None, None, LIFETIME_S))
    for _ in range(5):
        desk.book.invite(None, None, LIFETIME_S)
        desk.now_s += LIFETIME_S + 1
    for _ in range(3):
        desk.book.invite(None, None, LIFETIME_S)
    with pytest.raises(InputError, match="3 invitations are open: revoke some"):
        desk.book.invite(None, None, LIFETIME_S)
    desk.book.revoke(desk.book.invitations()[0].id)
    assert desk.redeem(desk.book.invite(None, None, LIFETIME_S), "pi-8").machine == "pi-8"


def test_a_program_that_holds_the_book_and_stands_still_is_not_waited_for(
    desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(book_module, "_PATIENCE_S", 0.1)
    with (desk.folder / AUTHORITY_FOLDER / ".joining.lock").open("a") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        with pytest.raises(InputError, match="held by another program"):
            desk.book.invite("pi-7", None, LIFETIME_S)
    desk.book.invite("pi-7", None, LIFETIME_S)
