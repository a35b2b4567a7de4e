"""What programs use of bpn: the same runs, episodes and policies as the commands, by functions."""

import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bpn
from bpn.dashboard import DashboardAwayError
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bnn.envelope import BlobError
from bpn_shared.errors import InputError
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.observation import stack

ROOT = Path(__file__).parents[2]
SMALL = {
    "iterations": 2,
    "episodes": 3,
    "steps": 6,
    "epochs": 1,
    "hidden_units": 8,
    "batch_size": 8,
}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> bpn.Run:
    return bpn.train(
        "tracking", runs_dir=tmp_path_factory.mktemp("runs"), quiet=True, seed=3, **SMALL
    )


def test_training_leaves_a_finished_run(run: bpn.Run) -> None:
    assert run.state == "finished"
    assert run.config.seed == 3
    assert len(run.records()) == 2


def test_it_is_opened_by_folder_id_and_beginning(run: bpn.Run) -> None:
    for name in (run.path, str(run.path)):
        assert bpn.open_run(name).id == run.id
    for name in (run.id, run.id[-6:]):
        assert bpn.open_run(name, runs_dir=run.path.parent).path == run.path


@pytest.mark.parametrize("name", ["nothing", "no/such/folder", ".", "/"])
def test_what_is_no_run_is_said(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no run"):
        bpn.open_run(name if name != "no/such/folder" else ".", runs_dir=tmp_path)


def test_metrics_are_a_table_of_the_records(run: bpn.Run) -> None:
    table = run.metrics()
    assert table["return_px"].tolist() == [record["return_px"] for record in run.records()]
    assert list(table["iteration"]) == [0, 1]


def test_episodes_have_the_rewards_that_were_learned_from(run: bpn.Run) -> None:
    episodes = list(run.episodes())
    assert [(one.meta.iteration, one.meta.episode) for one in episodes] == [
        (i, e) for i in (0, 1) for e in range(3)
    ]
    for iteration, record in enumerate(run.records()):
        found = [float(one.rewards.sum()) for one in run.episodes(iteration)]
        np.testing.assert_allclose(found, record["returns_px"])


def test_rewards_that_are_not_installed_are_those_that_were_told(
    run: bpn.Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    exact = [one.rewards for one in run.episodes()]
    values = run.config.model_dump()
    values["task_spec"]["rewards"] = "of_somebody_else"
    elsewhere = bpn.Run(run.folder)
    monkeypatch.setattr(elsewhere, "config", RunConfig.parse(values))
    for one, rewards in zip(elsewhere.episodes(), exact, strict=True):
        np.testing.assert_allclose(one.rewards, rewards, atol=6e-4)


def test_the_policy_prefers_and_acts_as_the_golden_model(run: bpn.Run) -> None:
    rng = np.random.default_rng(1)
    for version in (0, 2, None):
        weights = run.weights(version)
        assert isinstance(weights, WeightBlob)
        policy = run.policy(version)
        assert policy.version == (2 if version is None else version)
        for episode in run.episodes(1):
            for step in range(episode.steps):
                observation = policy.observation(list(episode.frames[: step + 1]))
                np.testing.assert_array_equal(observation, stack(list(episode.frames), step, 2))
                outputs = golden.forward(weights, observation)[-1]
                np.testing.assert_array_equal(
                    policy.preferences(observation), outputs * np.float64(weights.scale)
                )
                assert policy.act(observation) == np.argmax(outputs)
                probabilities = policy.probabilities(observation)
                assert probabilities.sum() == pytest.approx(1)
                assert np.argmax(probabilities) == np.argmax(outputs)
                assert 0 <= policy.act(observation, rng=rng) < policy.task.actions


def test_drawn_actions_are_as_probable_as_it_says(run: bpn.Run) -> None:
    policy = run.policy(kernel="golden")
    observation = np.random.default_rng(0).integers(0, 256, policy.observation_shape, np.uint8)
    rng = np.random.default_rng(2)
    drawn = [policy.act(observation, rng=rng) for _ in range(400)]
    share = np.bincount(drawn, minlength=policy.task.actions) / len(drawn)
    assert abs(share - policy.probabilities(observation)).max() < 0.1


def test_an_unknown_version_is_said(run: bpn.Run) -> None:
    with pytest.raises(InputError, match=r"version = 9: not in .* the newest is 2"):
        run.policy(9)


def test_wrong_arguments_are_said_in_a_line(run: bpn.Run) -> None:
    policy = run.policy()
    seen = np.zeros(policy.observation_shape, np.uint8)
    with pytest.raises(InputError, match="version = 'newest' is neither a number nor 'best'"):
        run.policy("newest")  # type: ignore[arg-type]
    for wrong, said in (
        ([1, 2], "is a list, not a numpy array"),
        (seen.astype(np.float32), r"is float32\[.*not uint8\["),
        (seen[:, 1:], r"is uint8\[6, 83, 84\], not uint8\[6, 84, 84\]"),
    ):
        for asked in (policy.act, policy.preferences, policy.probabilities):
            with pytest.raises(InputError, match=said):
                asked(wrong)  # type: ignore[operator]
    with pytest.raises(InputError, match="at least one"):
        policy.observation([])
    with pytest.raises(InputError, match=r"a frame is uint8\[6, 84, 84\], not uint8\[3, 84, 84\]"):
        policy.observation([seen])


def test_weights_of_another_network_are_refused(run: bpn.Run, tmp_path: Path) -> None:
    """An evaluation with them would wait for ever, an export would be another policy."""
    copy = tmp_path / run.id
    shutil.copytree(run.path, copy)
    other = RunConfig.for_task("tracking", **{**SMALL, "hidden_units": 9}).network
    blob = replace(WeightBlob.random(other, np.random.default_rng(0)), version=2)
    (copy / "weights" / "000002.bpnw").write_bytes(blob.encode())
    for asked in (None, 2):
        with pytest.raises(BlobError, match=r"another network, C=6, N=9, .* the run's is C=6, N=8"):
            bpn.open_run(copy).weights(asked)


def test_folders_and_files_are_paths_or_their_names(run: bpn.Run, tmp_path: Path) -> None:
    path = tmp_path / "policy.c"
    assert run.export("c", str(path)) == [path]
    assert path.stat().st_size > 0
    assert bpn.Dashboard.find(str(run.path.parent)) is None


def test_evaluation_is_that_of_the_command(run: bpn.Run) -> None:
    found = bpn.evaluate(run, trials=2)
    assert found.result["trials"] == len(found.episodes) == 2
    assert found.result["run_id"] == run.id
    policy = run.policy()
    for episode in found.episodes:
        assert episode.actions[0] == policy.act(policy.observation([episode.frames[0]]))


def test_a_run_that_is_resumed_keeps_its_configuration(run: bpn.Run) -> None:
    with pytest.raises(InputError, match="leave out --seed"):
        bpn.train(resume=run.id, runs_dir=run.path.parent, seed=4)
    with pytest.raises(InputError, match="leave out --hidden-units"):
        bpn.train(resume=run.id, runs_dir=run.path.parent, hidden_units=4)


def test_the_docs_program_has_eight_lines_and_runs(run: bpn.Run) -> None:
    page = (ROOT / "docs/python.md").read_text()
    program = page.split("```python\n")[1].split("```")[0]
    assert len([line for line in program.splitlines() if line.strip()]) <= 8
    program = program.replace("runs/RUN", str(run.path))
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60
    )
    policy, (first, *_) = run.policy(), run.episodes(1)
    action = policy.act(policy.observation(list(first.frames[:1])))
    assert done.stdout.splitlines()[0].split()[0] == policy.task.action_names[action].split()[0]


def test_a_dashboard_that_is_away_is_said_with_and_without_a_token(
    free_tcp_port: Callable[[], int],
) -> None:
    url = f"http://127.0.0.1:{free_tcp_port()}"
    for dashboard in (bpn.Dashboard(url), bpn.Dashboard(url, "token")):
        with pytest.raises(DashboardAwayError, match=r"does not answer: .*[Cc]onnect"):
            dashboard.runs()


def test_importing_it_is_light() -> None:
    program = "import bpn, sys; print(*sorted({name.partition('.')[0] for name in sys.modules}))"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60
    )
    heavy = {"numpy", "torch", "mujoco", "pydantic", "rich", "httpx", "pandas", "zenoh", "cv2"}
    assert not heavy & set(done.stdout.split())


def test_every_public_name_is_there_and_documented() -> None:
    assert set(bpn.__all__) <= set(dir(bpn))
    for name in bpn.__all__:
        found = getattr(bpn, name)
        assert isinstance(found, str) or found.__doc__
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        bpn.nothing  # noqa: B018
