"""One version of everything: the distributions, the images, the manifests."""

import re
import tomllib
from pathlib import Path

import yaml

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
