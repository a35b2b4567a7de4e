"""The commands that help and pages show: all are understood, and those that take seconds are run as they stand."""

import contextlib
import io
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

import bpn
from bpn.cli import COMMANDS, main, parse

ROOT = Path(__file__).parents[2]
RUN_HERE = {"doctor", "eval", "export", "runs", "train", "verify"}
SMALL = shlex.split(
    "--iterations 1 --episodes 2 --steps 6 --epochs 1 --hidden-units 8 --batch-size 8"
)
INCOMPLETE = ("the following arguments are required", "expected one argument")
"""What is said of a command that prose only names."""


class Documented(NamedTuple):
    """A command, where it is said, and whether as something to copy."""

    where: str
    text: str
    whole: bool

    @property
    def words(self) -> list[str]:
        return shlex.split(self.text, comments=True)[1:]


def documented() -> Iterator[Documented]:
    for name, command in COMMANDS.items():
        for example in command.examples:
            yield Documented(f"bpn {name} --help", example, True)
    for page in [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")]:
        if page.name == "CHANGELOG.md" or "results" in page.parts:  # of another time
            continue
        where, text = page.relative_to(ROOT).as_posix(), page.read_text()
        for block in re.findall(r"^```sh\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
            for line in block.replace("\\\n", " ").splitlines():
                if line.startswith("bpn "):
                    yield Documented(where, line, True)
        prose = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
        for found in re.findall(r"`(bpn [a-z][^`\n]*)`", prose):
            yield Documented(where, found, False)


ALL = list(dict.fromkeys(documented()))


@pytest.mark.parametrize("command", ALL, ids=lambda one: f"{one.where}: {one.text}")
def test_it_is_understood(command: Documented) -> None:
    assert not why_not_understood(command)


def why_not_understood(command: Documented) -> str:
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
            parse(command.words)
    except SystemExit as end:
        if end.code == 0 or (
            not command.whole and any(one in said.getvalue() for one in INCOMPLETE)
        ):
            return ""
        return said.getvalue()
    return ""


def test_there_are_many_from_many_pages() -> None:
    assert len(ALL) > 50
    assert len({command.where for command in ALL}) > 15


def test_every_command_has_an_example_of_its_own() -> None:
    for name, command in COMMANDS.items():
        assert command.examples
        assert all(example.split()[:2] == ["bpn", name] for example in command.examples)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> bpn.Run:
    runs_dir = tmp_path_factory.mktemp("documented") / "runs"
    return bpn.train(
        "reaching", runs_dir=runs_dir, quiet=True, iterations=1, episodes=2, steps=6, epochs=1,
        hidden_units=8, batch_size=8, evaluate_every=1, evaluate_episodes=1,
    )  # fmt: skip


def runnable() -> list[list[str]]:
    """Those that need neither a dashboard nor hours, once each, in small."""
    found = []
    for command in ALL:
        words = command.words
        if not command.whole or words[0] not in RUN_HERE or "--resume" in words:
            continue
        if words[:2] in (["runs", "start"], ["runs", "export"]) or "gym:" in command.text:
            continue
        if words[0] == "runs" and words[1] not in ("ls", "show", "prune", "trash"):
            continue
        if words[0] == "train":
            words = [*words, *SMALL]
        if words[0] == "eval":
            words = [*words, "--trials", "1"]
        own = any("own" in word for word in words)  # of the examples' packages
        placeholders = {word for word in words if word.isupper()} - {"RUN"}
        if words not in found and not own and not placeholders:
            found.append(words)
    return found


@pytest.mark.parametrize("words", runnable(), ids=" ".join)
def test_it_runs_as_it_stands(
    words: list[str], run: bpn.Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    given = [run.id if word == "RUN" else word for word in words]
    if words[0] not in ("doctor", "train"):
        given += ["--runs-dir", str(run.path.parent)]
    assert main(given) == 0
