"""`bpn up` for other machines and `bpn join`, as far as they need no network."""

import socket
from pathlib import Path

import pytest

from bpn.addresses import own_addresses
from bpn.certified import can_sign, hosts, prepare
from bpn.cli import main
from bpn.joined import services_of_machine
from bpn.pool import PoolSize
from bpn_certificates.book import Book
from bpn_certificates.joining import Machine
from bpn_certificates.token import Token
from bpn_shared.bus.access import ROUTER
from bpn_shared.bus.address import is_loopback
from bpn_shared.bus.admitted import read_admitted
from bpn_shared.bus.certificates import CERTIFICATE, FOLDER_VARIABLE
from bpn_shared.bus.identity import Identity
from bpn_shared.bus.x509 import facts_of

Said = pytest.CaptureFixture[str]
MACHINE = Identity.of("router", "lab-b", "pi-7")


def refusal(words: list[str], capsys: Said, status: int = 2) -> str:
    assert main(words) == status
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    return error


def test_a_start_after_the_first_keeps_who_has_joined_and_all_names(tmp_path: Path) -> None:
    prepare(tmp_path, "tls/0.0.0.0:7447", ["192.0.2.1"])
    Book(tmp_path).admit(MACHINE)
    authority = (tmp_path / "authority" / CERTIFICATE).read_bytes()
    edge = (tmp_path / "edge" / CERTIFICATE).read_bytes()
    prepare(tmp_path, "tls/0.0.0.0:7447", ["center.example"])
    assert (tmp_path / "authority" / CERTIFICATE).read_bytes() == authority
    assert (tmp_path / "edge" / CERTIFICATE).read_bytes() == edge
    assert read_admitted(tmp_path / ROUTER) == (MACHINE,)
    names = facts_of(tmp_path / ROUTER / CERTIFICATE).server_names
    assert names == {"192.0.2.1", "center.example", "localhost", "127.0.0.1"}
    assert hosts(tmp_path, ["center.example"]) == ("center.example", "192.0.2.1")
    assert can_sign(tmp_path)


def test_a_router_at_one_address_is_named_so(tmp_path: Path) -> None:
    prepare(tmp_path, "tls/192.0.2.7:7447", [])
    assert hosts(tmp_path) == ("192.0.2.7",)


def test_a_router_everywhere_has_this_machines_addresses(tmp_path: Path) -> None:
    prepare(tmp_path, "tls/0.0.0.0:7447", [])
    assert list(hosts(tmp_path)) == (own_addresses() or ["localhost"])
    for address in own_addresses():
        assert not is_loopback(address)
        with socket.socket() as listener:
            listener.bind((address, 0))  # they are this machine's


def test_robots_and_edges_speak_to_their_machines_router_and_show_whose_it_is(
    tmp_path: Path,
) -> None:
    machine = Machine(tmp_path, MACHINE, "192.0.2.1", 7447, 7448)
    router, *workers = services_of_machine(
        machine, PoolSize(2, 1, 0), "unixsock-stream/x", {"minigrid"}
    )
    assert router.arguments[-4:] == [
        "--upstream", "tls/192.0.2.1:7447", "--certificates", str(tmp_path),
    ]  # fmt: skip
    assert [worker.name for worker in workers] == ["robot-0", "robot-1", "edge-0"]
    for worker in workers:
        assert "unixsock-stream/x" in worker.arguments
        assert worker.environment == {FOLDER_VARIABLE: str(tmp_path)}
        assert ("minigrid" in worker.arguments) == worker.name.startswith("robot")


def test_a_machine_with_an_address_of_ipv6_has_an_endpoint(tmp_path: Path) -> None:
    assert Machine(tmp_path, MACHINE, "2001:db8::1", 1, 2).endpoint == "tls/[2001:db8::1]:1"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "this machine has not joined yet"),
        (["bpn1-nonsense"], "is no token, or not whole"),
        (["--robots", "65"], "--robots = 65 must be 0 to 64"),
        (
            [str(Token(("localhost",), 9, bytes(32), bytes(16))), "--name", "Pi 7"],
            "--name = 'Pi 7'",
        ),
    ],
)
def test_wrong_input_is_told_in_one_line(
    words: list[str], said: str, tmp_path: Path, capsys: Said
) -> None:
    state = ["--state-dir", str(tmp_path / "state")]
    assert said in refusal(["join", *words, *state], capsys)
    assert not (tmp_path / "state" / "machine.json").exists()


def test_nobody_there_is_told_with_place_and_remedy(tmp_path: Path, capsys: Said) -> None:
    token = str(Token(("127.0.0.1",), 9, bytes(32), bytes(16)))
    said = refusal(["join", token, "--state-dir", str(tmp_path)], capsys, 1)
    assert "127.0.0.1 port 9: Connection refused" in said
    assert "bpn up --listen" in said


def test_what_a_machine_remembers_is_checked(tmp_path: Path, capsys: Said) -> None:
    for damaged in ("", "{", "[]", '{"common_name": "edge"}', '{"host": 1}'):
        (tmp_path / "machine.json").write_text(damaged)
        said = refusal(["join", "--state-dir", str(tmp_path)], capsys)
        assert "join again with a new token" in said


@pytest.mark.parametrize("words", [["invite"], ["machines"]])
def test_without_an_authority_there_is_nothing_to_do(
    words: list[str], tmp_path: Path, capsys: Said
) -> None:
    assert "has no authority" in refusal([*words, "--runs-dir", str(tmp_path)], capsys)


def test_machines_are_listed_and_removed(tmp_path: Path, capsys: Said) -> None:
    folder = tmp_path / ".certificates"
    prepare(folder, "tls/0.0.0.0:7447", ["192.0.2.1"])
    where = ["--runs-dir", str(tmp_path)]
    assert main(["machines", *where]) == 0
    assert capsys.readouterr().out == "no machine has joined\n"
    Book(folder).admit(MACHINE)
    assert main(["machines", *where]) == 0
    assert capsys.readouterr().out.startswith("pi-7  router of site lab-b  since ")
    assert main(["machines", "--remove", "pi-7", *where]) == 0
    assert capsys.readouterr().out == "removed router@lab-b.pi-7\n"
    assert "no machine 'pi-7'" in refusal(["machines", "--remove", "pi-7", *where], capsys)


def test_a_port_for_machines_that_cannot_join_is_no_option(tmp_path: Path, capsys: Said) -> None:
    words = ["up", "--runs-dir", str(tmp_path), "--enrolment-port", "0"]
    assert "--enrolment-port is for a router that others reach" in refusal(words, capsys)
    assert "nobody can be admitted here" in refusal([*words, "--listen", "tcp/127.0.0.1:0"], capsys)
