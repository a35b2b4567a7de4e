"""Plug-ins are found among installed entry points, loaded when used, and told apart by their distribution."""

import sys
from pathlib import Path

import pytest
from installed import install

from bpn_shared import plugins
from bpn_shared.errors import InputError
from bpn_shared.plugins import Group, PluginError, UnknownPluginError

GROUP = Group("bpn.examples", "example")


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of packages that this process sees."""
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def test_listing_and_finding_import_nothing(site: Path) -> None:
    install(
        site, "lamps", {"bpn.examples": {"lamp": "lamps_of_theirs:lamp", "bulb": "nowhere:bulb"}}
    )
    (site / "lamps_of_theirs.py").write_text("lamp = 'shines'")
    assert plugins.names(GROUP) == ("bulb", "lamp")
    found = plugins.find(GROUP, "lamp")
    assert (found.name, found.distribution) == ("lamp", "lamps 1.0")
    assert "lamps_of_theirs" not in sys.modules
    assert found.load() == plugins.load(GROUP, "lamp") == "shines"


def test_what_is_not_installed_is_said_with_what_is(site: Path) -> None:
    install(
        site, "lamps", {"bpn.examples": {"lamp": "lamps:lamp"}, "bpn.others": {"os": "os:getcwd"}}
    )
    for name in ("os", "os:system", "lamp:"):
        with pytest.raises(
            UnknownPluginError, match=rf"example '{name}' is not .*there are: lamp\."
        ):
            plugins.load(GROUP, name)
    with pytest.raises(UnknownPluginError, match="there are: none"):
        plugins.load(Group("bpn.nobody", "nothing"), "x")


def test_two_of_one_name_name_both_and_hinder_no_other(site: Path) -> None:
    install(site, "lamps", {"bpn.examples": {"lamp": "os:sep", "other": "os:sep"}})
    install(site, "torches", {"bpn.examples": {"lamp": "os:curdir"}}, version="2.1")
    with pytest.raises(
        PluginError, match=r"'lamp' is in lamps 1\.0 and torches 2\.1.*pip uninstall"
    ):
        plugins.find(GROUP, "lamp")
    assert plugins.names(GROUP) == ("lamp", "other")
    assert plugins.load(GROUP, "other") == "/"


@pytest.mark.parametrize(
    ("reference", "said"),
    [
        ("nowhere_at_all:x", "No module named 'nowhere_at_all'"),
        ("os:no_such_thing", "no attribute 'no_such_thing'"),
        ("ends_early:x", "SystemError: too early"),
        ("a_script:x", "SystemExit: 0"),
    ],
)
def test_broken_is_one_line_with_distribution_and_remedy(
    site: Path, reference: str, said: str
) -> None:
    install(site, "lamps", {"bpn.examples": {"lamp": reference}})
    (site / "a_script.py").write_text("import sys\nsys.exit(0)")
    (site / "ends_early.py").write_text("raise SystemError('too\\nearly')")
    with pytest.raises(PluginError) as caught:
        plugins.load(GROUP, "lamp")
    line = str(caught.value)
    assert "\n" not in line
    assert said in line
    assert "lamps 1.0" in line
    assert "pip uninstall lamps" in line


def test_a_function_that_raises_is_a_broken_plugin_unless_it_says_what_was_wrong(
    site: Path,
) -> None:
    install(site, "lamps", {"bpn.examples": {"lamp": "lamp_maker:make"}})
    (site / "lamp_maker.py").write_text(
        "from bpn_shared.errors import InputError\n"
        "def make(watts):\n"
        "    if watts < 0:\n"
        "        raise InputError(f'watts = {watts}: give at least 0')\n"
        "    return 1 / watts\n"
    )
    lamp = plugins.find(GROUP, "lamp")
    assert lamp.call(2) == 0.5
    with pytest.raises(PluginError, match=r"lamps 1\.0.*ZeroDivisionError"):
        lamp.call(watts=0)
    with pytest.raises(InputError, match="watts = -1: give at least 0") as caught:
        lamp.call(-1)
    assert not isinstance(caught.value, PluginError)
