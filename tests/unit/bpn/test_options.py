"""Help tells the defaults that will apply, and the docs' claims about presets hold."""

import argparse
import re
from pathlib import Path

import pytest
from paper import TASKS

from bpn.cli import parse
from bpn.options import add_run_options, common_defaults
from bpn_shared.spec.config import OPTIONS, RunConfig

ANY_GYM = "gym:Anything-v0"
FOUND_OUT = {"actions", "action_dims"}
NAMED = [*TASKS, "gym:CartPole-v1", ANY_GYM]


def config_of(task: str) -> RunConfig:
    return RunConfig.for_task(task, **{"actions": 2} if task == ANY_GYM else {})


def told(arguments: list[str]) -> dict[str, str]:
    """The default that help shows for each option."""
    parser = argparse.ArgumentParser()
    add_run_options(parser, arguments)
    found = {}
    for action in parser._actions:
        if match := re.search(r"; default (.*)$", action.help or ""):
            found[action.dest] = match.group(1)
    return found


@pytest.mark.parametrize("task", NAMED)
def test_help_of_a_task_tells_what_its_runs_get(task: str) -> None:
    shown = told(["--seed", "3", task])
    assert set(shown) == set(OPTIONS) - {"task"}
    for name in shown:
        if name in FOUND_OUT and task == ANY_GYM:
            assert shown[name] == "found out"
        else:
            value = getattr(config_of(task), name)
            assert shown[name] == f"{'none' if value == '' else value} for {task}"


def test_help_without_a_task_tells_only_what_holds_for_all() -> None:
    shown = told([])
    for name in set(OPTIONS) - {"task"}:
        values = {str(getattr(config_of(task), name)) or "none" for task in NAMED}
        if name in FOUND_OUT:
            values.add("found out")
        assert shown[name] == (values.pop() if len(values) == 1 else "by task")
    assert shown["hidden_units"] == shown["bootstrap_terminals"] == "by task"
    assert common_defaults()["seed"] == 0


@pytest.mark.parametrize("command", [["train"], ["runs", "start"]])
def test_commands_show_them(command: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parse([*command, "reaching", "--help"])
    said = " ".join(capsys.readouterr().out.split())
    assert "hidden units, of FC(N) (≥ 1, ≤ 1024); default 256 for reaching" in said


def test_docs_say_that_targets_are_relative_in_all_presets() -> None:
    page = (Path(__file__).parents[3] / "docs/algorithms/README.md").read_text()
    assert re.search(r"`relative_targets` .*; on in all presets \|", page)
    assert all(config_of(task).relative_targets for task in NAMED)
