"""Disturbances as text and data."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from bpn_shared.errors import InputError
from bpn_shared.spec.disturbances import KINDS, of_scope, parse, shown
from bpn_shared.spec.installed import task_spec
from bpn_shared.spec.tasks import TaskOptions, TaskSpec

levels = st.fixed_dictionaries(
    {},
    optional={
        name: st.tuples(*[st.floats(kind.lowest, kind.highest)] * 2).map(sorted).map(tuple)
        for name, kind in KINDS.items()
    },
)


@given(levels)
def test_what_is_shown_is_parsed_to_the_same(given_levels: dict[str, tuple[float, float]]) -> None:
    assert parse(shown(given_levels)) == given_levels


def test_a_number_is_a_range_of_one() -> None:
    assert parse("noise=25,offset=-30..30") == {"noise": (25, 25), "offset": (-30, 30)}
    assert parse("") == {}


@pytest.mark.parametrize(
    ("text", "remedy"),
    [
        ("noise", "must be KIND=LEVEL"),
        ("noise=loud", "must be KIND=LEVEL"),
        ("noise=nan", "must be KIND=LEVEL"),
        ("noise=1..", "noise"),
        ("fog=3", "'fog' is unknown; one of: noise"),
        ("noise=-1", "within 0..128"),
        ("offset=30..-30", "the lower end first"),
        ("noise=1,noise=2", "given twice"),
        ("jpeg=0", "within 1..100"),
    ],
)
def test_an_impossible_text_gets_one_line(text: str, remedy: str) -> None:
    if text == "noise=1..":
        assert parse(text) == {"noise": (1, 1)}
        return
    with pytest.raises(InputError, match=remedy) as error:
        parse(text)
    assert "\n" not in str(error.value)


def test_a_specification_has_only_possible_ones() -> None:
    spec = task_spec("reaching", TaskOptions())
    assert spec.disturbances == {}
    data = spec.model_dump() | {"disturbances": {"offset": (-5, 5), "noise": (0, 9)}}
    assert list(TaskSpec.model_validate(data).disturbances) == ["noise", "offset"]
    with pytest.raises(ValidationError, match="fog"):
        TaskSpec.model_validate(spec.model_dump() | {"disturbances": {"fog": (0, 1)}})


def test_scopes_are_apart() -> None:
    found = parse("noise=1,latency=5,backlash=2")
    assert [list(of_scope(found, scope)) for scope in ("picture", "time", "servo")] == [
        ["noise"], ["latency"], ["backlash"],
    ]  # fmt: skip


def test_every_kind_has_numbers_of_its_own() -> None:
    assert sorted(kind.number for kind in KINDS.values()) == list(range(len(KINDS)))
