"""One version of everything: `shared/pyproject.toml` says it, these files repeat it, `make version` writes it.

Also the licence's text, which every distribution needs in its own folder.
"""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

SOURCE = "shared/pyproject.toml"
DISTRIBUTIONS = (
    "shared",
    "services/edge",
    "services/learner",
    "services/robot",
    "services/robot_sim",
    "services/tasks",
    "services/dashboard",
    "deploy/certificates",
    "bpn",
)
_OWN = r'^version = "([^"]+)"'
_PINS = r'"bpn-[a-z-]+(?:\[[a-z,]+\])?==([^"]+)"'
_REPEATED = {
    **{f"{folder}/pyproject.toml": (_OWN, _PINS) for folder in DISTRIBUTIONS},
    ".env": (r"^BPN_VERSION=(.+)$",),
    "CITATION.cff": (r"^version: (.+)$",),
    "deploy/kubernetes/kustomization.yaml": (r"newTag: (\S+)",),
    "services/dashboard/web/package.json": (r'^  "version": "([^"]+)"',),
    "services/dashboard/web/package-lock.json": (
        r'"name": "bpn-dashboard-web",\s+"version": "([^"]+)"',
    ),
}


def repeated(root: Path) -> dict[str, tuple[str, ...]]:
    """Every file that repeats the version, the examples' too, and the patterns whose group it is."""
    examples = sorted(root.glob("examples/*/pyproject.toml"))
    return _REPEATED | {path.relative_to(root).as_posix(): (_OWN,) for path in examples}


def version(root: Path) -> str:
    """The version of the repository at `root`."""
    return str(tomllib.loads((root / SOURCE).read_text())["project"]["version"])


def check(root: Path) -> Iterator[str]:
    """One line for every file with another version, or none, and every other licence."""
    wanted = version(root)
    for name, patterns in repeated(root).items():
        text = (root / name).read_text()
        found = {said for pattern in patterns for said in re.findall(pattern, text, re.MULTILINE)}
        if found != {wanted}:
            said = ", ".join(sorted(found)) or "no version"
            yield f"{name} says {said}, {SOURCE} {wanted}: make version"
    licence = (root / "LICENSE").read_bytes()
    for folder in DISTRIBUTIONS:
        if (root / folder / "LICENSE").read_bytes() != licence:
            yield f"{folder}/LICENSE is another than LICENSE"


def write(root: Path) -> None:
    """Writes the version wherever it is repeated."""
    wanted = version(root)
    for name, patterns in repeated(root).items():
        text = (root / name).read_text()
        for pattern in patterns:
            text = re.sub(
                pattern,
                lambda match: match[0].replace(match[1], wanted),
                text,
                flags=re.MULTILINE,
            )
        (root / name).write_text(text)


if __name__ == "__main__":
    write(Path.cwd())
