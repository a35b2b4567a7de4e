"""The examples, installed from their folders: one run with all of them, alone and by a dashboard's workers."""

import os
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from example_packages import ALL, install_examples, train_with
from flags import flags
from pool import Pool, running_pool

from bpn.testing import check_kernel
from bpn_shared.messages.episode import Episode
from bpn_shared.runs.folder import RunFolder

Command = Callable[..., list[str]]
LONG_S = 200.0
SMALL = {"iterations": 2, "episodes": 2, "epochs": 1}
OWN = {"task": "centre", "kernel": "blas", "callbacks": "gap"}
LIGHTS = '''
import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete


class Light(gymnasium.Env):
    """A bar that grows with every step; its colour is the keyword argument's."""

    observation_space, action_space = Box(0, 255, (84, 84, 3), np.uint8), Discrete(3)

    def __init__(self, colour):
        self.colour = colour

    def seen(self):
        image = np.zeros((84, 84, 3), np.uint8)
        image[:, : 10 + 2 * self.count] = self.colour
        return image

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.count = 0
        return self.seen(), {}

    def step(self, action):
        self.count += 1
        return self.seen(), float(action), self.count == 12, False, {}


gymnasium.register("Light-v0", entry_point=Light)
'''


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Where all examples are installed, and a package with a Gymnasium environment."""
    site = tmp_path_factory.mktemp("site")
    (site / "lights.py").write_text(LIGHTS)
    return install_examples(site, *ALL)


@pytest.fixture(scope="module")
def trained(
    environment: dict[str, str], command: Command, tmp_path_factory: pytest.TempPathFactory
) -> Callable[..., dict[str, Any]]:
    runs_dir = tmp_path_factory.mktemp("runs")

    def train(**values: Any) -> dict[str, Any]:
        told = train_with(environment, command, runs_dir, "centre", *flags(SMALL | values))
        return told | {"folder": RunFolder.open(runs_dir, told["run_id"])}

    return train


@pytest.fixture(scope="module")
def alone(trained: Callable[..., dict[str, Any]]) -> dict[str, Any]:
    """The run by `bpn train`, without a dashboard."""
    return trained(kernel="blas", callbacks="gap")


def uses_all(folder: RunFolder) -> None:
    """The kernel and the callback were at work."""
    config = folder.config()
    assert (config.task, config.kernel, config.callbacks) == ("centre", "blas", "gap")
    first, second = folder.metrics()
    assert "return_change" not in first
    assert second["return_change"] == second["return_px"] - first["return_px"]
    assert "kernel blas" in (folder.logs / "edge-0.log").read_text()


def test_a_kernel_and_a_callback_change_no_weights(
    alone: dict[str, Any], trained: Callable[..., dict[str, Any]]
) -> None:
    uses_all(alone["folder"])
    assert trained()["weights_sha256"] == alone["weights_sha256"]


def test_the_kernel_passes_the_check(
    environment: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(environment["PYTHONPATH"].split(os.pathsep)[0])
    from own_kernel import BlasKernel

    check_kernel(BlasKernel())


@pytest.fixture(scope="module")
def pool(environment: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Pool]:
    """`bpn up` where they are installed, and robots may import the environment's module."""
    place = tmp_path_factory.mktemp("pool")
    with running_pool(place, "--allow-gym-modules", "lights", environment=environment) as running:
        yield running


def test_a_dashboards_workers_train_it_to_the_same_weights(
    pool: Pool, alone: dict[str, Any], wait_for: Callable[..., None]
) -> None:
    run = pool.dashboard.create_run(OWN | SMALL)["id"]
    wait_for(lambda: pool.state(run) in {"finished", "failed"}, "the run to end", LONG_S)
    assert pool.state(run) == "finished", pool.run(run)
    uses_all(pool.folder(run))
    assert pool.sha256(run) == alone["weights_sha256"]


def test_arguments_and_modules_of_an_environment_travel_to_workers(
    pool: Pool, wait_for: Callable[..., None]
) -> None:
    values = {
        "task": "gym:lights:Light-v0", "env_kwargs": '{"colour": [200, 100, 50]}', "frame_channels": 3,
        "steps": 5,
    }  # fmt: skip
    run = pool.dashboard.create_run(values | SMALL)["id"]
    wait_for(lambda: pool.state(run) in {"finished", "failed"}, "the run to end", LONG_S)
    assert pool.state(run) == "finished", pool.run(run)
    folder = pool.folder(run)
    episode = Episode.decode(folder.episode_path(0, 0).read_bytes(), folder.config().task_spec)
    assert episode.frames[:, :, 40, 4].tolist() == [[200, 100, 50]] * 6
    assert folder.config().actions == 3
