import subprocess
import sys

import pytest

from bpn.cli import COMMANDS, main, parse

HEAVY = ("torch", "numpy", "pydantic", "httpx", "rich", "zenoh", "mujoco", "fastapi", "sqlalchemy")


def test_a_command_that_is_not_given_loads_nothing() -> None:
    look = f"import sys, bpn.cli; print([name for name in {HEAVY} if name in sys.modules])"
    found = subprocess.run(
        [sys.executable, "-c", look], capture_output=True, text=True, timeout=60, check=True
    )
    assert found.stdout.strip() == "[]"


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        parse([name, "--help"])
    assert ended.value.code == 0
    said = capsys.readouterr().out
    assert said.startswith(f"usage: bpn {name} ")
    assert f"`bpn {name}`" in said  # the module says what it is


def test_without_a_command_all_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([])
    assert ended.value.code == 2
    with pytest.raises(SystemExit):
        main(["--help"])
    said = capsys.readouterr().out
    assert all(command.help in said for command in COMMANDS.values())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["bench", "kernel", "--quick"], "--quick are of `bpn bench dashboard`, not kernel"),
        (["bench", "dashboard", "--parts", "series,moon"], "--parts moon: there are series, lists"),
    ],
)
def test_options_of_another_benchmark_are_refused(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    assert message in capsys.readouterr().err
