"""One version of everything: the distributions, the images, the manifests."""

import re
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from bpn_certificates import command as certificates
from bpn_dashboard.options import argument_parser
from bpn_shared import version
from bpn_shared.bus import router
from bpn_shared.runtime.entry import argument_parser as worker_parser
from bpn_shared.version import VERSION

ROOT = Path(__file__).parents[3]


def test_all_distributions_have_one_version() -> None:
    found = [
        tomllib.loads(path.read_text())
        for path in ROOT.glob("**/pyproject.toml")
        if "node_modules" not in path.parts and ".venv" not in path.parts
    ]
    versions = {project["project"]["version"] for project in found if "project" in project}
    assert versions == {VERSION}


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
