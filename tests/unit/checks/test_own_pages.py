"""The pages about parts of one's own show what the examples have, so that whoever copies it has what is tested."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
PAGES = {
    "docs/own-callback.md": "own_callback",
    "docs/own-kernel.md": "own_kernel",
    "docs/own-robot.md": "own_task",
    "docs/tasks/own.md": "own_task",
}


def blocks(page: str, language: str) -> list[str]:
    text = (ROOT / page).read_text()
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize(("page", "example"), PAGES.items())
def test_a_page_shows_its_example(page: str, example: str) -> None:
    folder = ROOT / "examples" / example
    source, packaging = (
        (folder / f"{example}.py").read_text(),
        (folder / "pyproject.toml").read_text(),
    )
    assert f"./examples/{example}" in (ROOT / page).read_text()  # how it is installed
    for block in blocks(page, "toml"):
        assert block in packaging
    for block in blocks(page, "python"):
        if "bpn.testing" not in block:  # what checks it is no part of it
            assert block.rstrip() in source
        else:
            for names in re.findall(rf"from {example} import (.+)", block):
                assert all(f" {name}" in source for name in re.split(r", ", names))


def test_the_pages_with_code_are_those_that_have_some() -> None:
    shown = [page for page in PAGES if any("bpn.testing" not in b for b in blocks(page, "python"))]
    assert shown == ["docs/own-callback.md", "docs/own-robot.md"]
    assert all(blocks(page, "toml") for page in PAGES if page != "docs/tasks/own.md")
