"""Algorithms of other packages: a broken one is said, and hinders no other."""

from pathlib import Path

import pytest
from installed import install

from bpn_shared.plugins import PluginError
from bpn_shared.spec.algorithms import find_algorithm, offered_algorithms

_THEIRS = """
from pydantic import BaseModel
from bpn_shared.spec.algorithms import Algorithm, AlgorithmSpec

class Options(BaseModel):
    tau: float

SLOW = Algorithm(AlgorithmSpec(name="slow", targets="cvi"), Options)
"""


def test_options_without_a_default_are_said_and_the_others_offered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "slow_of_theirs.py").write_text(_THEIRS)
    install(tmp_path, "slow", {"bpn.algorithms": {"slow": "slow_of_theirs:SLOW"}})
    with pytest.raises(
        PluginError, match=r"slow 1\.0.*is broken: its options have no default: tau"
    ):
        find_algorithm("slow")
    names = {algorithm.spec.name for algorithm in offered_algorithms()}
    assert "bpn" in names
    assert "slow" not in names
