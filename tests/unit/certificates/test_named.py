"""Certificates of single machines, made where the authority is."""

from pathlib import Path

import pytest

from bpn_certificates.book import Book
from bpn_certificates.command import main
from bpn_certificates.invitations import main as invite_main
from bpn_certificates.token import Token
from bpn_shared.bus.admitted import read_admitted
from bpn_shared.bus.certificates import CERTIFICATE, CertificateFiles
from bpn_shared.bus.identity import Identity
from bpn_shared.bus.obstacle import own_obstacle
from bpn_shared.bus.x509 import facts_of


def test_one_machines_certificate_is_made_admitted_and_renewed(tmp_path: Path) -> None:
    given = [str(tmp_path), "--role", "robot_sim", "--name", "pi-7", "--site", "lab-b"]
    assert main(given) == 0
    folder = tmp_path / "machines" / "pi-7" / "robot_sim"
    robot = Identity.of("robot_sim", "lab-b", "pi-7")
    assert own_obstacle(CertificateFiles.in_folder(folder)) == ""
    assert facts_of(folder / CERTIFICATE).common_name == robot.common_name
    assert facts_of(folder / CERTIFICATE).server_names == frozenset()
    assert read_admitted(tmp_path / "router") == (robot,)
    before = (folder / CERTIFICATE).read_bytes()
    assert main([str(tmp_path)]) == 0
    assert (folder / CERTIFICATE).read_bytes() == before
    assert main([str(tmp_path), "--days", "2000"]) == 0  # a quarter of that is not left
    assert (folder / CERTIFICATE).read_bytes() != before
    Book(tmp_path).remove("pi-7")
    assert read_admitted(tmp_path / "router") == ()


def test_a_router_has_several_names(tmp_path: Path) -> None:
    names = ["--server-name", "192.0.2.1,center.example", "--server-name", "localhost"]
    assert main([str(tmp_path), *names]) == 0
    assert facts_of(tmp_path / "router" / CERTIFICATE).server_names == {
        "192.0.2.1", "center.example", "localhost",
    }  # fmt: skip


@pytest.mark.parametrize(
    "wrong",
    [["--role", "edge"], ["--name", "pi-7"], ["--site", "a"], ["--role", "learner", "--name", "x"],
     ["--role", "edge", "--name", "X"], ["--role", "edge", "--name", "x", "--site", "main"],
     ["--router", "machines"]],
)  # fmt: skip
def test_half_a_machine_is_refused(
    wrong: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main([str(tmp_path / "certificates"), *wrong])
    assert "error: " in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_invitations_where_the_bpn_command_is_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = str(tmp_path)
    assert invite_main([folder]) == 2
    assert "has no authority" in capsys.readouterr().err
    assert main([folder, "--server-name", "center.example"]) == 0
    assert invite_main([folder]) == 2
    assert "nobody admits machines here yet" in capsys.readouterr().err
    Book(tmp_path).place_door(["center.example"], 7448)
    capsys.readouterr()
    assert invite_main([folder, "--name", "pi-7", "--minutes", "5"]) == 0
    word = capsys.readouterr().out.removeprefix("bpn join ").strip()
    assert (Token.parse(word).hosts, Token.parse(word).port) == (("center.example",), 7448)
    assert invite_main([folder, "--host", "other.example"]) == 2
    assert "is not for other.example" in capsys.readouterr().err
    assert invite_main([folder, "--list"]) == 0
    listed = capsys.readouterr().out
    assert "for pi-7" in listed
    assert invite_main([folder, "--revoke", listed.split()[0]]) == 0
    assert invite_main([folder, "--list"]) == 0
    assert "no invitations are open" in capsys.readouterr().out
    assert invite_main([folder, "--machines"]) == 0
    assert "no machine has joined" in capsys.readouterr().out
    for wrong in (["--minutes", "0"], ["--minutes", "nan"], ["--site", "main"], ["--name", "A"]):
        assert invite_main([folder, *wrong]) == 2
        assert capsys.readouterr().err.count("\n") == 1
