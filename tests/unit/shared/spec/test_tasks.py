"""A task is data that travels by value; who creates a run finds it by its name, nobody else looks it up."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from installed import install
from paper import TASKS
from pydantic import ValidationError

from bpn_shared.errors import InputError
from bpn_shared.runs.config_file import decode_config, encode_config
from bpn_shared.spec.config import ConfigError, RunConfig
from bpn_shared.spec.installed import offered, preset_of, task_names, task_spec
from bpn_shared.spec.tasks import TaskFamily, TaskOptions, TaskSpec

NAMES = st.from_regex(r"\A[a-z][a-z0-9_.-]{0,20}\Z")
TEXTS = st.text(min_size=1, max_size=30)


@st.composite
def specs(draw: st.DrawFn) -> TaskSpec:
    action_names = tuple(draw(st.lists(TEXTS, min_size=2, max_size=64)))
    channels = draw(st.sampled_from([1, 3]))
    success = draw(st.sampled_from(["last_reward", "not_terminated", "told", "undefined"]))
    return TaskSpec(
        name=draw(NAMES),
        title=draw(st.text(max_size=30)),
        robot=draw(NAMES),
        rewards=draw(st.none() | NAMES),
        reward_unit=draw(st.sampled_from(["px", ""])),
        plot=draw(st.none() | NAMES),
        frame_channels=channels,
        frames_stacked=draw(st.integers(1, 16 // channels)),
        frame_skip=draw(st.integers(1, 100)),
        action_names=action_names,
        hold_action=draw(st.integers(0, len(action_names) - 1)),
        control_period_s=draw(st.floats(1e-3, 60)),
        realtime=draw(st.booleans()),
        success=success,
        success_reward=draw(st.floats(-1e6, 1e6)) if success == "last_reward" else None,
        preset=draw(
            st.dictionaries(
                NAMES, st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | TEXTS,
                max_size=5,
            )
        ),
    )  # fmt: skip


@given(specs())
def test_a_specification_survives_the_trip_through_json(spec: TaskSpec) -> None:
    read = TaskSpec.model_validate_json(spec.model_dump_json())
    assert read == spec
    kinds = {name: type(value) for name, value in read.preset.items()}
    assert kinds == {name: type(value) for name, value in spec.preset.items()}


@given(specs())
def test_a_configuration_carries_its_task_which_nobody_has_installed(spec: TaskSpec) -> None:
    config = RunConfig(task=spec.name, task_spec=spec)
    assert config.network.actions == spec.actions
    assert (config.frame_channels, config.frames_stacked) == (
        spec.frame_channels,
        spec.frames_stacked,
    )
    assert RunConfig.from_json(config.model_dump_json().encode(), source="the bus") == config
    assert decode_config(encode_config(config), source="config.json") == config


@pytest.mark.parametrize(("changes", "reason"), [
    ({"frame_channels": 2}, r"must be 1 \(gray\) or 3"),
    ({"frame_channels": 3, "frames_stacked": 6}, "at most 16 channels"),
    ({"hold_action": 14}, r"hold_action = 14: there are the actions 0..13"),
    ({"action_names": ["only"]}, "action_names"),
    ({"success": "told"}, "success_reward belongs to"),
    ({"robot": "os:system"}, "robot = 'os:system'"),
    ({"rewards": "../x"}, "rewards = '../x'"),
    ({"name": "far"}, "task = 'reaching': its task_spec is that of 'far'"),
    ({"warp": 1}, "task_spec.warp"),
    ({"realtime": False}, "'reaching' has no clock of its own"),
])  # fmt: skip
def test_an_impossible_specification_is_refused_with_its_value(
    changes: dict[str, Any], reason: str
) -> None:
    values = TASKS["reaching"].model_dump() | changes
    with pytest.raises(ConfigError, match=reason):
        RunConfig.parse({"task": "reaching", "task_spec": values, "pacing": "realtime"})


PLUGIN = """
from bpn_shared.spec.tasks import TaskFamily, TaskSpec
def lamp():
    return TaskSpec(name="lamp", robot="lamp", frame_channels=1, action_names=("on", "off"),
                    control_period_s=0.1, preset={"steps": 7})
def liar():
    return lamp()
def late():
    raise KeyError("x")
def lamps(name, options):
    return lamp().model_copy(update={"name": name, "frame_skip": options.frame_skip or 4})
street = TaskFamily(which="STREET", title="Lamps of a street", make=lamps, preset=lambda name: {"steps": 9})
shade = TaskFamily(which="LAMP", title="Shades", make=lamps, preset=lambda name: {"steps": 1 // 0})
"""


@pytest.fixture
def lamps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    points = {
        name: f"plugin_of_lamps:{name}" for name in ("lamp", "liar", "late", "street", "shade")
    }
    install(tmp_path, "lamps", {"bpn.tasks": points | {"gone": "not_there:x", "number": "math:pi"}})
    (tmp_path / "plugin_of_lamps.py").write_text(PLUGIN)
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


@pytest.mark.usefixtures("lamps")
def test_a_task_of_another_package_is_found_and_offered() -> None:
    assert RunConfig.for_task("lamp").steps == 7
    config = RunConfig.for_task("street:broad", frame_skip=2, seed=3)
    assert (config.task_spec.name, config.frame_skip, config.steps) == ("street:broad", 2, 9)
    assert RunConfig.for_task("street:broad").frame_skip == 4
    tasks = offered()
    assert [spec.name for spec in tasks.specs].count("lamp") == 1
    assert tasks.families["street"].which == "STREET"
    assert (tasks.presets["lamp"]["steps"], tasks.presets["street:"]) == (7, {"steps": 9})
    offered_names = (
        {spec.name for spec in tasks.specs} | tasks.families.keys() | tasks.presets.keys()
    )
    assert not offered_names & {"liar", "late", "shade", "shade:", "gone", "number"}
    assert {"lamp", "gone"} <= set(task_names().replace(",", "").split())


@pytest.mark.usefixtures("lamps")
@pytest.mark.parametrize(("name", "reason"), [
    ("dark", "task = 'dark': unknown; one of: "),
    ("street", "task = 'street': unknown; street:STREET is what street has"),
    ("lamp:x", "task = 'lamp:x': unknown; lamp is what lamp has"),
    ("late", r"task 'late' .*lamps 1.0\) is broken: KeyError: 'x'.*pip uninstall lamps"),
    ("liar", r"lamps 1.0\) is broken: what it has for 'liar' is no TaskSpec of that name"),
    ("gone", r"lamps 1.0\) is broken: .*not_there"),
    ("number", r"lamps 1.0\) is broken: "),
])  # fmt: skip
def test_what_cannot_be_a_task_is_one_line(name: str, reason: str) -> None:
    asked: list[Callable[[str], object]] = [
        preset_of,
        lambda name: task_spec(name, TaskOptions()),
        RunConfig.for_task,
        RunConfig.bare,
    ]
    for ask in asked:
        with pytest.raises(InputError, match=reason) as caught:
            ask(name)
        assert "\n" not in str(caught.value)


def test_a_configuration_from_the_bus_imports_nothing(lamps: Path) -> None:
    """It is read where the plug-in is installed, by a process that must not have loaded it."""
    config = RunConfig.for_task("lamp")
    program = (
        "import sys; from bpn_shared.spec.config import RunConfig\n"
        "config = RunConfig.from_json(sys.stdin.buffer.read(), source='the bus')\n"
        "assert config.task_spec.robot == 'lamp'\n"
        "loaded = {'plugin_of_lamps', 'bpn_tasks'} & set(sys.modules)\n"
        "assert not loaded, loaded\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        input=config.model_dump_json().encode(),
        env={"PYTHONPATH": str(lamps)},
        capture_output=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr.decode()


def test_families_are_told_by_kind() -> None:
    assert isinstance(offered().families["gym"], TaskFamily)
    assert set(TASKS) <= {spec.name for spec in offered().specs}


def test_disturbances_that_a_task_has_itself_can_be_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "foggy_task.py").write_text(
        "from bpn_shared.spec.tasks import TaskSpec\n"
        "def spec():\n"
        "    return TaskSpec(name='foggy', robot='foggy', frame_channels=1, action_names=('a', 'b'),\n"
        "                    control_period_s=0.1, disturbances={'blur': (0, 2)})\n"
    )
    install(tmp_path, "foggy", {"bpn.tasks": {"foggy": "foggy_task:spec"}})
    assert RunConfig.for_task("foggy").disturb == "blur=0..2"
    assert RunConfig.bare("foggy").disturb == "blur=0..2"
    for disturb, levels in (("", {}), ("noise=3", {"noise": (3.0, 3.0)})):
        config = RunConfig.for_task("foggy", disturb=disturb)
        assert (config.disturb, config.task_spec.disturbances) == (disturb, levels)


@pytest.mark.parametrize("reward", [float("inf"), float("nan"), "9" * 500])
def test_a_reward_that_no_file_could_hold_is_refused(reward: object) -> None:
    values = {
        "name": "a",
        "robot": "a",
        "frame_channels": 1,
        "action_names": ("a", "b"),
        "control_period_s": 1,
    }
    with pytest.raises(ValidationError, match="success_reward"):
        TaskSpec.model_validate(values | {"success": "last_reward", "success_reward": reward})
