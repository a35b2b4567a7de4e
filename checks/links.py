"""Relative links and anchors in all pages that git knows."""

import subprocess
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

from checks.text import anchors, links


def check(root: Path) -> Iterator[str]:
    """One line for every link that leads nowhere."""
    files = _files(root)
    for name in sorted(file for file in files if file.endswith(".md")):
        page = (root / name).read_text()
        for line, target in links(page):
            if fault := _fault(root, name, unquote(target), files):
                yield f"{name}:{line}: ({target}) {fault}"


def _fault(root: Path, page: str, target: str, files: set[str]) -> str:
    if target.startswith(("http://", "https://", "mailto:")):
        return ""
    path, _, anchor = target.partition("#")
    found = ((root / page).parent / path).resolve() if path else (root / page).resolve()
    if not found.is_relative_to(root.resolve()):
        return "leads out of the repository"
    name = found.relative_to(root.resolve()).as_posix()
    if name not in files and not any(file.startswith(f"{name}/") for file in files):
        return "is not among the files that git knows"
    if anchor and anchor not in anchors(found.read_text()):
        return f"has no heading for #{anchor}"
    return ""


def _files(root: Path) -> set[str]:
    """Tracked files, and new ones that git does not ignore."""
    command = [
        "git",
        "-C",
        str(root),
        "ls-files",
        "-z",
        "--cached",
        "--others",
        "--exclude-standard",
    ]
    listed = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603
    return {name for name in listed.stdout.split("\0") if name and (root / name).exists()}
