"""Whether an environment can be a task is asked of a robot worker, or of a process of one's own."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from bpn_robot_sim.probe import probe_in_child
from bpn_shared.bus.requests import NoReplyError
from bpn_shared.bus.session import Bus
from bpn_shared.messages.probe import ProbeReply, ProbeRequest
from bpn_shared.runtime.probing import probe_by_worker
from bpn_shared.spec.config import ConfigError

ODD = """
import os, time
import gymnasium
from gymnasium.envs.classic_control import CartPoleEnv

class Loud(CartPoleEnv):
    def reset(self, **options):
        print("a banner")
        os.write(1, b"a banner of C code\\n")
        return super().reset(**options)

class Crashing(CartPoleEnv):
    def step(self, action):
        os.abort()

class Hanging(CartPoleEnv):
    def step(self, action):
        time.sleep(600)

for kind in (Loud, Crashing, Hanging):
    gymnasium.register(f"bpn-odd/{kind.__name__}-v0", entry_point=kind)
"""


@pytest.fixture
def odd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Environments that every new Python process has registered."""
    (tmp_path / "sitecustomize.py").write_text(ODD)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))


@pytest.mark.usefixtures("odd")
def test_a_process_of_its_own_survives_what_environments_do() -> None:
    loud = probe_in_child(ProbeRequest(task="gym:bpn-odd/Loud-v0"))
    assert loud == ProbeReply(actions=2, dims=(2,), seen="renders")
    with pytest.raises(ConfigError, match="ended with status -6 while it was tried out"):
        probe_in_child(ProbeRequest(task="gym:bpn-odd/Crashing-v0"))
    with pytest.raises(ConfigError, match="took longer than 10 s"):
        probe_in_child(ProbeRequest(task="gym:bpn-odd/Hanging-v0"), timeout_s=10)
    with pytest.raises(ConfigError, match=r"^gym:Nope-v0 cannot be made: NameNotFound: [^\n]+$"):
        probe_in_child(ProbeRequest(task="gym:Nope-v0"))


def test_an_idle_robot_worker_answers(
    endpoint: str, open_bus: Callable[[], Bus], wait_for: Callable[..., None]
) -> None:
    bus = open_bus()
    asked = ProbeRequest(task="gym:CartPole-v1", frame_channels=3)
    with pytest.raises(NoReplyError):
        probe_by_worker(bus, asked)
    worker = subprocess.Popen([sys.executable, "-m", "bpn_robot_sim", "--connect", endpoint])
    found: list[ProbeReply] = []

    def answered() -> bool:
        try:
            found.append(probe_by_worker(bus, asked))
        except NoReplyError:
            return False
        return True

    try:
        wait_for(answered, "the worker to answer")
        assert found == [ProbeReply(actions=2, dims=(2,), seen="renders")]
        with pytest.raises(ConfigError, match=r"^gym:Pendulum-v1 has 1 actions, a policy has"):
            probe_by_worker(bus, ProbeRequest(task="gym:Pendulum-v1", action_bins=1))
    finally:
        worker.terminate()
        worker.wait(10)


WITNESS = """
import pathlib, gymnasium
from gymnasium.envs.classic_control import CartPoleEnv
pathlib.Path(__file__).with_name("imported").touch()
gymnasium.register("Witness/Cart-v0", entry_point=CartPoleEnv)
"""


def test_what_comes_over_the_bus_makes_no_worker_import_but_what_it_allows(
    endpoint: str,
    open_bus: Callable[[], Bus],
    wait_for: Callable[..., None],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (tmp_path / "witness.py").write_text(WITNESS)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    bus, imported = open_bus(), tmp_path / "imported"
    asked = ProbeRequest(task="gym:witness:Witness/Cart-v0", crop="0,100,600,300")
    for allow in ([], ["--allow-gym-modules", "witness"]):
        worker = subprocess.Popen(
            [sys.executable, "-m", "bpn_robot_sim", "--connect", endpoint, *allow]
        )
        found: list[ProbeReply | str] = []

        def answered(found: list[ProbeReply | str] = found) -> bool:
            try:
                found.append(probe_by_worker(bus, asked))
            except ConfigError as error:
                found.append(str(error))
            except NoReplyError:
                return False
            return True

        try:
            wait_for(answered, "the worker to answer")
        finally:
            worker.terminate()
            worker.wait(10)
        if allow:
            assert found == [ProbeReply(actions=2, dims=(2,), seen="renders")]
        else:
            assert "needs the module 'witness', which is not allowed here" in str(found[0])
        assert imported.exists() == bool(allow)
