"""One version of everything: the distributions, the images, the manifests."""

import re
import shutil
import subprocess
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from bpn_certificates import command as certificates
from bpn_certificates import enrolment, invitations
from bpn_dashboard.options import argument_parser
from bpn_shared import version
from bpn_shared.bus import router
from bpn_shared.runtime.entry import argument_parser as worker_parser
from bpn_shared.version import VERSION
from checks import versions

ROOT = Path(__file__).parents[3]


def copied(root: Path) -> Path:
    """The files that say a version, and the licences."""
    names = [
        *versions.repeated(ROOT),
        "LICENSE",
        *(f"{one}/LICENSE" for one in versions.DISTRIBUTIONS),
    ]
    for name in names:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, root / name)
    return root


def test_everything_has_one_version_and_one_licence() -> None:
    assert versions.version(ROOT) == VERSION
    assert list(versions.check(ROOT)) == []


def test_every_distribution_is_among_them() -> None:
    listed = subprocess.run(
        ["git", "ls-files", "*pyproject.toml"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    projects = {
        name
        for name in listed.stdout.split()
        if "project" in tomllib.loads((ROOT / name).read_text())
    }
    assert projects == {name for name in versions.repeated(ROOT) if name.endswith("pyproject.toml")}


def test_another_version_is_written_everywhere(tmp_path: Path) -> None:
    root = copied(tmp_path)
    source = root / versions.SOURCE
    source.write_text(source.read_text().replace(f'version = "{VERSION}"', 'version = "7.8.9"'))
    # All but the source: its own line is right already, and it depends on none of ours.
    assert len(list(versions.check(root))) == len(versions.repeated(root)) - 1
    versions.write(root)
    assert list(versions.check(root)) == []
    assert '"bpn-edge[float]==7.8.9"' in (root / "bpn/pyproject.toml").read_text()


def test_another_licence_is_seen(tmp_path: Path) -> None:
    root = copied(tmp_path)
    (root / "bpn/LICENSE").write_text("all rights reserved")
    assert list(versions.check(root)) == ["bpn/LICENSE is another than LICENSE"]


def test_compose_tags_images_with_it() -> None:
    assert re.findall(r"^BPN_VERSION=(.*)$", (ROOT / ".env").read_text(), re.MULTILINE) == [VERSION]
    services = yaml.safe_load((ROOT / "compose.yaml").read_text())["services"]
    ours = {s["image"] for s in services.values() if s["image"].startswith("bpn-")}
    assert len(ours) > 6
    assert all(":${BPN_VERSION}" in image for image in ours)


@pytest.mark.parametrize(
    ("program", "main"),
    [
        ("bpn-router", router.main),
        ("bpn-certificates", certificates.main),
        ("bpn-enrolment", enrolment.main),
        ("bpn-invite", invitations.main),
        ("bpn-dashboard", argument_parser().parse_args),
        ("bpn-robot-sim", worker_parser("robot_sim", None).parse_args),
    ],
)
def test_every_program_tells_version_protocol_and_commit(
    program: str, main: Callable[[list[str]], object], capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setenv("BPN_COMMIT", "c0ffee")
    version.commit.cache_clear()
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    version.commit.cache_clear()
    assert ended.value.code == 0
    said = capsys.readouterr().out
    assert said == f"{program} {VERSION}, protocol {version.PROTOCOL}, commit c0ffee\n"
