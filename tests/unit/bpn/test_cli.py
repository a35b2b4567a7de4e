"""The command itself: what it loads, and how it ends when something is not as it should be."""

import json
import os
import shlex
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from uuid import UUID

import pytest

from bpn.cli import COMMANDS, main, parse
from bpn.outputs import check_output
from bpn_shared.errors import InputError
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import RunConfig
from bpn_shared.version import describe

HEAVY = ("torch", "numpy", "pydantic", "httpx", "rich", "zenoh", "mujoco", "fastapi", "sqlalchemy")
Command = Callable[..., list[str]]


def ended(words: list[str], **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        words, capture_output=True, text=True, timeout=60, check=False, env=os.environ | environment,
    )  # fmt: skip


def test_a_command_that_is_not_given_loads_nothing() -> None:
    look = f"import sys, bpn.cli; print([name for name in {HEAVY} if name in sys.modules])"
    assert ended([sys.executable, "-c", look]).stdout.strip() == "[]"


@pytest.mark.parametrize(
    "arguments", [["train", "--help"], ["up", "--help"], ["runs", "ls"], ["runs", "--help"]]
)
def test_commands_that_simulate_nothing_load_no_mujoco_and_no_torch(arguments: list[str]) -> None:
    look = (
        "import sys, contextlib; from bpn.cli import main\n"
        f"with contextlib.suppress(SystemExit): main({arguments})\n"
        "print('loaded:', [name for name in ('mujoco', 'torch') if name in sys.modules])"
    )
    done = ended([sys.executable, "-c", look], MUJOCO_GL="nonsense")
    assert done.stdout.splitlines()[-1] == "loaded: []", done.stderr


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
    alone = capsys.readouterr().err
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    assert capsys.readouterr().out == alone
    assert all(command.help in alone for command in COMMANDS.values())


def test_it_tells_its_version(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert ended.value.code == 0
    assert capsys.readouterr().out == f"bpn {describe()}\n"
    assert describe().startswith(f"{version('bpn')}, protocol ")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["bench", "kernel", "--quick"], "--quick are of `bpn bench dashboard`, not kernel"),
        (["bench", "dashboard", "--parts", "series,moon"], "--parts moon: there are series, lists"),
        (
            ["train"],
            "TASK is missing; one of: arm, gym:[MODULE:]ENVIRONMENT-ID, pan_tilt, pan_tilt_both, reaching, ",
        ),
        (["train", "reaching", "--runs-dir", "/proc/x"], "--runs-dir /proc/x: No such file"),
        (["train", "reaching", "--runs-dir", "FILE"], "FILE: File exists; choose a folder"),
        (["train", "reaching", "--runs-dir", "FILE/x"], "FILE/x: Not a directory; choose a folder"),
        (["up", "--port", "0", "--runs-dir", "/proc/x"], "--runs-dir /proc/x: No such file"),
        (["up", "--port", "0", "--runs-dir", "FILE"], "FILE: File exists; choose a folder"),
        (["up", "--port", "99999"], "--port = 99999 must be 0 to 65535; 0 takes any free one"),
        (["up", "--port", "-1"], "--port = -1 must be 0 to 65535"),
        (["eval", "nothing"], "no run in runs matches 'nothing'; there are none"),
        (["reproduce", "reaching", "--runs-dir", "FILE"], "FILE: File exists; choose a folder"),
    ],
)
def test_wrong_input_is_one_line_and_makes_nothing(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "FILE").touch()
    assert main(arguments) == 2
    said = capsys.readouterr()
    assert message in said.err
    assert len(said.err.splitlines()) == 1
    assert said.out == ""
    assert [path.name for path in tmp_path.iterdir()] == ["FILE"]


def test_a_port_that_is_taken_is_told_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert main(["up", "--port", str(port), "--runs-dir", str(tmp_path / "runs")]) == 2
    assert f"--port = {port}: Address already in use; choose another" in capsys.readouterr().err
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("back_end", ["nonsense", "disabled"])
def test_opengl_that_does_not_work_is_told_before_a_run_is_made(
    back_end: str, tmp_path: Path, command: Command
) -> None:
    done = ended(command("train", "reaching", "--runs-dir", str(tmp_path)), MUJOCO_GL=back_end)
    assert done.returncode == 2
    assert done.stderr.startswith("bpn: task 'reaching' cannot be played here: OpenGL cannot")
    assert len(done.stderr.splitlines()) == 1
    assert not list(tmp_path.iterdir())
    report = ended(command("doctor", "--json"), MUJOCO_GL=back_end)
    assert report.returncode == 1
    rendering = json.loads(report.stdout)["rendering"]
    assert not rendering["works"]
    assert f"MUJOCO_GL='{back_end}'" in rendering["error"]


SLOW = """
import sys, time
class Slow:
    def find_spec(self, name, path=None, target=None):
        if name == "rich.console":
            print("loading", flush=True)
            time.sleep(60)
sys.meta_path.insert(0, Slow())
"""


@pytest.mark.parametrize("arguments", [["train", "reaching"], ["eval", "x"], ["doctor"]])
def test_an_interrupt_while_modules_are_loaded_is_no_traceback(
    arguments: list[str], command: Command, tmp_path: Path
) -> None:
    (tmp_path / "sitecustomize.py").write_text(SLOW)
    process = subprocess.Popen(
        command(*arguments), stderr=subprocess.PIPE, stdout=subprocess.PIPE,
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stdout.readline() == b"loading\n"
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=30)
    assert (process.returncode, said) == (130, b"")


def test_characters_that_a_terminal_lacks_are_spelled(command: Command) -> None:
    ascii_only = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    done = ended(command("train", "--help"), **ascii_only)
    assert done.returncode == 0
    assert "hidden units, of FC(N) (>= 1, <= 1024)" in " ".join(done.stdout.split())
    show = "from bpn.terminal import spare_encoding; spare_encoding(); print('1 \\xb1 2 \\xfc \\u20ac')"
    assert ended([sys.executable, "-c", show], **ascii_only).stdout == "1 +- 2 ? ?\n"


def test_what_is_printed_by_others_is_not_among_the_results() -> None:
    show = (
        "import os; from bpn.terminal import stdout_for_results\n"
        "with stdout_for_results():\n    print('python'); os.write(1, b'c code\\n')\n"
        "print('result')"
    )
    done = ended([sys.executable, "-c", show])
    assert done.stdout == "result\n"
    assert set(done.stderr.split("\n")) >= {"python", "c code"}


def test_an_error_of_the_system_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("bpn.commands.doctor.examine", (tmp_path / "gone").read_bytes)
    assert main(["doctor"]) == 1
    assert capsys.readouterr().err == f"bpn: {tmp_path / 'gone'}: No such file or directory\n"


def test_several_matches_are_listed_and_no_others(tmp_path: Path) -> None:
    ids = [f"01a20000-0000-7000-8000-00000000{n:04x}" for n in range(8)]
    for run in ids:
        RunFolder.create(tmp_path, UUID(run), RunConfig.bare("reaching"))
    with pytest.raises(InputError) as several:
        RunFolder.open(tmp_path, "01a20000")
    assert str(several.value).startswith(f"8 runs in {tmp_path} match '01a20000': {ids[3]}, ")
    assert "and 3 more" in str(several.value)
    assert RunFolder.open(tmp_path, "0002").path.name == ids[2]
    with pytest.raises(InputError, match=r"no run in .* matches 'f00'; the newest are: "):
        RunFolder.open(tmp_path, "f00")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("film.avi", "the name must end with one of .mp4, .gif"),
        ("none/film.mp4", "there is no folder"),
        ("folder.mp4", "Is a directory"),
    ],
)
def test_an_output_that_cannot_be_written_is_known_before(
    name: str, message: str, tmp_path: Path
) -> None:
    (tmp_path / "folder.mp4").mkdir()
    with pytest.raises(InputError, match=message):
        check_output("--video", tmp_path / name, (".mp4", ".gif"))
    check_output("--video", tmp_path / "FILM.MP4", (".mp4", ".gif"))
    assert [path.name for path in tmp_path.iterdir()] == ["folder.mp4"]


def test_commands_to_copy_are_whole_and_quoted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    runs_dir = "r ü n"
    assert main(["runs", "start", "reaching", "--runs-dir", runs_dir]) == 2
    hint = capsys.readouterr().err.split("`")[1]
    assert shlex.split(hint) == ["bpn", "up", "--runs-dir", runs_dir]
