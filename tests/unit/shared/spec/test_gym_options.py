"""Options of gym: tasks: one text for one meaning, and one line for what has none."""

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_shared.errors import InputError
from bpn_shared.runs.config_file import decode_config, encode_config
from bpn_shared.runs.digests import seal
from bpn_shared.runtime.gym_modules import VARIABLE, allowed_modules, as_arguments, check_allowed
from bpn_shared.spec.config import ConfigError, RunConfig
from bpn_shared.spec.gym import Crop, GymOptions, id_of, modules_named
from bpn_shared.version import written_by

NAMES = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,8}", fullmatch=True)
MODULES = st.lists(NAMES, min_size=1, max_size=3).map(".".join)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**53), 2**53) | st.text(max_size=9),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=6,
)
KWARGS = st.dictionaries(
    NAMES.filter(lambda name: name not in ("id", "render_mode")), JSON, max_size=4
)


@st.composite
def options(draw: st.DrawFn) -> GymOptions:
    rectangle = draw(st.none() | st.tuples(*[st.integers(0, 999)] * 2, *[st.integers(1, 999)] * 2))
    wrappers = draw(st.lists(st.tuples(st.none() | MODULES, NAMES), max_size=3))
    return GymOptions(
        env_kwargs=json.dumps(draw(KWARGS), indent=draw(st.none() | st.just(1))),
        env_wrappers=draw(st.sampled_from((",", " , "))).join(
            f"{module}:{name}" if module else name for module, name in wrappers
        ),
        frames_from=draw(st.sampled_from(("auto", "observations"))),
        observation_key=draw(st.text(max_size=9)),
        crop=""
        if rectangle is None
        else draw(st.sampled_from((",", ", "))).join(map(str, rectangle)),
        max_over_frames=draw(st.integers(1, 5)),
        difference=draw(st.booleans()),
        action_bins=draw(st.integers(0, 64)),
    )


@given(options())
def test_a_configuration_keeps_them_in_its_file(given_options: GymOptions) -> None:
    config = RunConfig.for_task(
        "gym:some.pack:Space/Some-v0", actions=3, frame_skip=5, **dict(given_options)
    )
    assert config.alone() == config.task_spec.gym == given_options
    assert decode_config(encode_config(config), source="config.json") == config
    assert (
        GymOptions(**given_options.model_dump()) == given_options
    )  # its own text is kept as it is


@given(KWARGS)
def test_arguments_are_the_same_whatever_their_order_and_spaces(kwargs: dict[str, Any]) -> None:
    backwards = dict(reversed(kwargs.items()))
    one, other = (
        GymOptions(env_kwargs=json.dumps(v, indent=i)) for v, i in ((kwargs, 2), (backwards, None))
    )
    assert one == other
    assert one.arguments == kwargs


@given(st.tuples(*[st.integers(0, 99_999)] * 4))
def test_a_crop_has_a_size(numbers: tuple[int, int, int, int]) -> None:
    text = ",".join(map(str, numbers))
    if all(numbers[2:]):
        assert GymOptions(crop=text).crop_px == Crop(*numbers)
    else:
        with pytest.raises(ValueError, match="X,Y,WIDTH,HEIGHT"):
            GymOptions(crop=text)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (
            {"env_kwargs": "{continuous: False}"},
            "env_kwargs = '{continuous: False}': no JSON (Expecting",
        ),
        ({"env_kwargs": "[1]"}, "env_kwargs = '[1]': must be a JSON object"),
        ({"env_kwargs": '{"a": NaN}'}, "NaN is no number of JSON"),
        ({"env_kwargs": '{"render_mode": "human"}'}, "render_mode is not among them"),
        ({"env_wrappers": "a.b:c.d"}, "'a.b:c.d' must be MODULE:CLASS"),
        ({"env_wrappers": "A,b c"}, "'b c' must be MODULE:CLASS, or a class of gymnasium.wrappers"),
        ({"crop": "1,2,3"}, "crop = '1,2,3': must be X,Y,WIDTH,HEIGHT in pixels"),
        ({"crop": "-1,2,3,4"}, "must be X,Y,WIDTH,HEIGHT"),
        ({"difference": True, "frames_stacked": 1}, "difference = True with frames_stacked = 1"),
        ({"max_over_frames": 2}, "max_over_frames = 2 with frame_skip = 1"),
        ({"max_over_frames": 0}, "max_over_frames = 0: Input should be greater than or equal to 1"),
        ({"action_bins": 65}, "action_bins = 65: Input should be less than or equal to 64"),
        (
            {"frames_from": "render"},
            "frames_from = 'render': Input should be 'auto', 'observations' or",
        ),
        ({"frames_from": "renders", "observation_key": "rgb"}, "what is rendered has no keys"),
    ],
)
def test_a_wrong_option_is_one_line_with_its_name(changes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ConfigError) as refused:
        RunConfig.for_task("gym:A-v0", actions=2, **changes)
    assert sentence in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_file_from_before_these_options_has_none_of_them() -> None:
    config = RunConfig.for_task("gym:CartPole-v1")
    values = config.model_dump()
    for name in GymOptions.model_fields:
        del values[name]
    older = seal({"schema": 2, "written_by": written_by(), "config": values})
    assert decode_config(older, source="config.json") == config
    del values["alpha"]
    damaged = seal({"schema": 2, "written_by": written_by(), "config": values})
    with pytest.raises(ConfigError, match="alpha missing"):
        decode_config(damaged, source="config.json")


@given(st.none() | MODULES, st.lists(st.tuples(MODULES, NAMES), max_size=3))
def test_every_module_that_is_named_must_be_allowed(
    module: str | None, wrappers: list[tuple[str, str]]
) -> None:
    task = f"gym:{module}:A/B-v0" if module else "gym:A/B-v0"
    asked = GymOptions(env_wrappers=",".join(f"{m}:{name}" for m, name in wrappers))
    assert id_of(task) == (module or "", "A/B-v0")
    needed = modules_named(task, asked.env_wrappers)
    assert set(needed) == {*([module] if module else []), *(m for m, _ in wrappers)} - {
        "gymnasium.wrappers"
    }
    check_allowed(task, asked, needed)
    check_allowed(task, asked, {name.split(".")[0] for name in needed})  # with what is inside
    for missing in needed:
        others = {one for one in needed if not f"{missing}.".startswith(f"{one}.")}
        with pytest.raises(ConfigError) as refused:
            check_allowed(task, asked, others - {missing})
        said = str(refused.value)
        assert said.startswith(f"{task} needs the module '")
        assert "--allow-gym-modules" in said
        assert VARIABLE in said


def test_a_name_allows_what_is_inside_and_not_what_only_begins_so() -> None:
    with pytest.raises(ConfigError, match="needs the module 'minigrid_evil'"):
        check_allowed("gym:minigrid_evil:A-v0", GymOptions(), {"minigrid"})
    with pytest.raises(ConfigError, match=r"needs the module 'minigrid'.* minigrid, or set"):
        check_allowed("gym:minigrid:A-v0", GymOptions(), {"minigrid.wrappers"})


def test_the_list_is_of_option_and_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "ale_py minatar.gym")
    assert allowed_modules("") == {"ale_py", "minatar.gym"}
    assert allowed_modules("minigrid, highway_env") == {
        "ale_py",
        "minatar.gym",
        "minigrid",
        "highway_env",
    }
    assert as_arguments({"b", "a"}) == ["--allow-gym-modules", "a,b"]
    assert as_arguments(()) == []
    with pytest.raises(
        InputError, match="--allow-gym-modules: 'high-way' is no name of a Python module"
    ):
        allowed_modules("high-way")
    monkeypatch.setenv(VARIABLE, "a;b")
    with pytest.raises(InputError, match=f"{VARIABLE}: 'a;b' is no name"):
        allowed_modules("")
