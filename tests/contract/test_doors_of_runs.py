"""Every door to a new run knows the same tasks, finds out the same, and refuses in the same words."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from flags import flags

from bpn.cli import parse
from bpn.commands import train
from bpn.dashboard import Dashboard
from bpn.training import say_place
from bpn_dashboard.api.app import create_app
from bpn_dashboard.api.context import Context
from bpn_dashboard.database.engine import Database, sqlite_url
from bpn_dashboard.registry.store import RunStore
from bpn_dashboard.registry.workplace import ConnectedWorkers
from bpn_dashboard.series.ingest import Ingest
from bpn_robot_sim.probe import answer
from bpn_shared import plugins
from bpn_shared.bus import keys
from bpn_shared.bus.requests import Responder
from bpn_shared.bus.session import Bus
from bpn_shared.counters import Counters
from bpn_shared.errors import InputError
from bpn_shared.messages.lease import LeaseRequest, Role
from bpn_shared.runs.folder import RunFolder

Values = dict[str, Any]
Door = Callable[[str, Values], RunFolder]

TASKS: dict[str, Values] = {
    "reaching": {"seed": 3, "alpha": 0.5},
    "tracking": {"algorithm": "bqn"},
    "pan_tilt": {"iterations": 7},
    "gym:CartPole-v1": {"hidden_units": 64},
    "gym:MountainCar-v0": {
        "frames_stacked": 3, "bootstrap_terminals": True, "crop": "0,50,600,300", "difference": True,
        "frame_skip": 4, "max_over_frames": 2, "env_kwargs": '{"goal_velocity": 0.01}',
        "env_wrappers": "RecordEpisodeStatistics",
    },
    "gym:Pendulum-v1": {"action_bins": 5, "frames_from": "renders"},
    "gym:nobody.here:Has-v0": {"actions": 5, "env_wrappers": "nobody:Wraps"},
    "gym:nobody/Has-v0": {"actions": 5},  # given, so nobody opens it
}  # fmt: skip
"""One of every kind."""

WRONG: list[tuple[str, Values, str]] = [
    ("flying", {}, "one of: arm, gym:[MODULE:]ENVIRONMENT-ID, pan_tilt, pan_tilt_both, reaching, "),
    ("gym:", {}, "must be gym:[MODULE:]ENVIRONMENT-ID"),
    ("reaching", {"alpha": 1.5}, "Input should be less than or equal to 1"),
    ("reaching", {"pacing": "slow"}, "Input should be 'lockstep' or 'realtime'"),
    ("reaching", {"kernel": "onnx"}, "kernel = 'onnx' does not run the network of 'bpn'"),
    ("reaching", {"actions": 3}, "actions = 3: task 'reaching' has 14; leave it out"),
    ("reaching", {"algorithm": "dpp", "alpha": 0.5}, "alpha = 0.5: algorithm 'dpp' has alpha = 1"),
    ("gym:Pendulum-v1", {"action_bins": 1}, "has 1 actions, a policy has 2..64"),
    ("gym:CartPole-v1", {"env_kwargs": "{"}, "no JSON"),
    ("gym:CartPole-v1", {"env_kwargs": '{"length": 3}'}, "unexpected keyword argument 'length'"),
    ("gym:CartPole-v1", {"env_wrappers": "a:b:c"}, "must be MODULE:CLASS"),
    ("gym:CartPole-v1", {"env_wrappers": "Nothing"}, "gymnasium.wrappers has no wrapper"),
    ("gym:CartPole-v1", {"crop": "590,0,20,20"}, "beyond its pictures, which are 600 x 400"),
    ("gym:CartPole-v1", {"frames_from": "observations"}, "its observations are no images"),
    ("gym:CartPole-v1", {"observation_key": "rgb"}, "its observations are no Dict"),
    ("gym:CartPole-v1", {"action_bins": 3}, "which are discrete already: leave action_bins out"),
    ("reaching", {"crop": "0,0,9,9"}, "task 'reaching' is no Gymnasium environment; leave it out"),
    ("gym:NoSuch-v0", {}, "gym:NoSuch-v0 cannot be made"),
    ("reaching", {"callbacks": "best,nobody"}, "callback 'nobody' is not installed"),
    ("reaching", {"kernel": "abacus"}, "kernel 'abacus' is not installed"),
    ("gym:CartPole-v1", {"pacing": "realtime"}, "has no clock of its own; choose lockstep"),
    ("gym:nobody/Has-v0", {"pacing": "realtime"}, "has no clock of its own; choose lockstep"),
]


PLUGINS = [
    plugins.CALLBACKS, plugins.REWARDS, plugins.TARGETS, plugins.KERNELS, plugins.SELECTIONS, plugins.ROBOTS,
]  # fmt: skip


def telling(role: Role, **without: str) -> LeaseRequest:
    """What a worker tells when it asks for work, where all is installed but what is named by its group's noun."""
    have = {
        group.name: tuple(n for n in plugins.names(group) if n != without.get(group.noun))
        for group in PLUGINS
    }
    return LeaseRequest(role=role, worker=role.replace("_", "-"), plugins=have)


class Served:
    """The dashboard's application, with a robot worker on the bus, in front of both clients."""

    def __init__(self, folder: Path, bus: Bus) -> None:
        self.runs_dir = folder / "runs"
        self.told = [telling("learner"), telling("learner"), telling("edge"), telling("robot_sim")]
        self.database = Database(sqlite_url(folder / "dashboard.sqlite"))
        store, counters = RunStore(self.database, self.runs_dir), Counters()
        context = Context(
            self.database, store, Ingest(self.runs_dir, self.database, counters), counters,
            place=ConnectedWorkers(lambda: bus, lambda: self.told),
        )  # fmt: skip
        app = create_app(context, hosts=["localhost"])
        token = context.tokens.issue("token", "test", "operator")[1]
        headers = {"Authorization": f"Bearer {token}"}
        self.http = TestClient(app, base_url="http://localhost", headers=headers)
        self.dashboard = Dashboard("http://localhost", token, "", None)
        self.dashboard._http = self.http

    def folder(self, run_id: str) -> RunFolder:
        return RunFolder.open(self.runs_dir, run_id)

    def post(self, path: str, body: Values) -> Values:
        response = self.http.post(f"/api/v1{path}", json=body)
        answer: Values = response.json()
        if response.status_code == 201:
            return answer
        assert response.status_code == 422
        told = [item["message"] for item in answer["errors"]]
        raise InputError("\n".join([answer["detail"], *told]))


@pytest.fixture
def served(tmp_path: Path, open_bus: Callable[[], Bus]) -> Iterator[Served]:
    served = Served(tmp_path, open_bus())
    yield served
    served.database.close()


@pytest.fixture
def robot_worker(open_bus: Callable[[], Bus]) -> Iterator[None]:
    """Answers as every robot worker does, with a session of its own."""
    responder = Responder(open_bus(), keys.probe(), answer, Counters())
    yield
    del responder


def words(task: str, values: Values) -> list[str]:
    return [task, *flags(values)]


def doors(served: Served) -> dict[str, Door]:
    def command_line(task: str, values: Values) -> RunFolder:
        here = ["--runs-dir", str(served.runs_dir.parent / "alone")]
        return train.folder_of(parse(["train", *words(task, values), *here]), None)

    def command_line_with_dashboard(task: str, values: Values) -> RunFolder:
        here = ["--runs-dir", str(served.runs_dir)]
        return train.folder_of(parse(["train", *words(task, values), *here]), served.dashboard)

    def runs_start(task: str, values: Values) -> RunFolder:
        options = parse(["runs", "start", *words(task, values), "--json"])
        options.act(options, served.dashboard)
        newest = served.http.get("/api/v1/runs?limit=1").json()["items"][0]
        return served.folder(newest["id"])

    def rest(task: str, values: Values) -> RunFolder:
        return served.folder(served.post("/runs", {"config": {"task": task, **values}})["id"])

    def sweep(task: str, values: Values) -> RunFolder:
        body = {"name": "one", "config": {"task": task, **values}}
        return served.folder(served.post("/sweeps", body)["run_ids"][0])

    def sweep_of_tasks(task: str, values: Values) -> RunFolder:
        body = {"name": "one", "config": {"task": "reaching"}, "grid": {"task": [task]}}
        body["grid"] |= {name: [value] for name, value in values.items()}
        return served.folder(served.post("/sweeps", body)["run_ids"][0])

    return {
        one.__name__: one
        for one in (
            command_line, command_line_with_dashboard, runs_start, rest, sweep, sweep_of_tasks,
        )
    }  # fmt: skip


@pytest.mark.usefixtures("robot_worker")
@pytest.mark.parametrize("task", TASKS)
def test_every_kind_of_task_comes_in_by_every_door(task: str, served: Served) -> None:
    values = TASKS[task]
    configs = {name: door(task, values).config() for name, door in doors(served).items()}
    (config, *others) = configs.values()
    assert {name for name, one in configs.items() if one != config} == set(), others
    assert {name: getattr(config, name) for name in values} == values
    assert config.task == task
    found_out = {"gym:MountainCar-v0": 3, "gym:Pendulum-v1": 5}
    assert config.actions == found_out.get(task, config.task_spec.actions)
    opened = task.startswith("gym:") and "actions" not in values
    assert config.frames_from == ("renders" if opened else "auto")


@pytest.mark.usefixtures("robot_worker")
@pytest.mark.parametrize(("task", "values", "sentence"), WRONG)
def test_what_is_wrong_is_refused_in_the_same_words_and_makes_nothing(
    task: str, values: Values, sentence: str, served: Served
) -> None:
    for name, door in doors(served).items():
        with pytest.raises(InputError) as refused:
            door(task, values)
        assert sentence in str(refused.value), name
    assert not list(served.runs_dir.parent.glob("*/*/config.json"))


@pytest.mark.usefixtures("robot_worker")
def test_a_module_that_workers_may_not_import_is_named_and_nothing_is_made(served: Served) -> None:
    by_dashboard = {name: door for name, door in doors(served).items() if name != "command_line"}
    for task, values in (
        ("gym:nobody.here:Has-v0", {}),
        ("gym:CartPole-v1", {"env_wrappers": "nobody.here:Wraps"}),
    ):
        for name, door in by_dashboard.items():
            with pytest.raises(InputError) as refused:
                door(task, values)
            for part in ("'nobody.here'", "--allow-gym-modules nobody", "BPN_GYM_MODULES=nobody"):
                assert part in str(refused.value), name
    assert not list(served.runs_dir.parent.glob("*/*/config.json"))


def test_a_run_from_elsewhere_names_no_module_that_is_allowed(served: Served) -> None:
    door = doors(served)["command_line"]
    folder = door("gym:nobody.here:Has-v0", {"actions": 3})
    resume = ["train", "--resume", str(folder.run), "--runs-dir", str(folder.path.parent)]
    with pytest.raises(InputError, match=r"needs the module 'nobody\.here'.*--allow-gym-modules"):
        train.folder_of(parse(resume), None)
    allowed = train.folder_of(parse([*resume, "--allow-gym-modules", "nobody"]), None)
    assert allowed.run == folder.run


def test_without_a_robot_worker_unknown_actions_are_one_clear_sentence(served: Served) -> None:
    by_dashboard = {name: door for name, door in doors(served).items() if name != "command_line"}
    for name, door in by_dashboard.items():
        with pytest.raises(
            InputError, match="no robot worker is connected that could open"
        ) as refused:
            door("gym:MountainCar-v0", {})
        assert "or give actions" in str(refused.value), name
        assert door("gym:MountainCar-v0", {"actions": 3}).config().actions == 3
        assert door("gym:CartPole-v1", {}).config().actions == 2  # its preset knows


@pytest.mark.usefixtures("robot_worker")
@pytest.mark.parametrize(
    ("role", "noun", "name", "who"),
    [
        ("learner", "callback", "best", "connected learners"),
        ("learner", "rewards", "reaching", "connected learners"),
        ("learner", "targets", "cvi", "connected learners"),
        ("edge", "kernel", "native", "connected edges"),
        ("edge", "action selection", "softmax", "connected edges"),
        ("robot_sim", "robot", "reaching", "connected robots"),
    ],
)
def test_what_no_worker_has_that_would_need_it_is_said_and_nothing_is_made(
    role: Role, noun: str, name: str, who: str, served: Served
) -> None:
    by_dashboard = {name: door for name, door in doors(served).items() if name != "command_line"}
    values = {"callbacks": "best", "kernel": "native"}
    others = [told for told in served.told if told.role != role]
    served.told = [*others, telling(role, **{noun: name}), telling(role, **{noun: name})]
    for door_name, door in by_dashboard.items():
        with pytest.raises(InputError) as refused:
            door("reaching", values)
        expected = f"{noun} {name!r} is not installed at any of the 2 {who}; there are: "
        assert expected in str(refused.value), door_name
        assert "start them again" in str(refused.value), door_name
        assert ("BPN_KERNEL" in str(refused.value)) == (noun == "kernel"), door_name
    assert not list(served.runs_dir.glob("*/config.json"))
    silent = LeaseRequest(role=role, worker="silent")
    for told in ([telling(role, **{noun: name}), telling(role)], [silent]):
        served.told = [*others, *told]
        assert by_dashboard["rest"]("reaching", values).config().callbacks == "best"


def test_runs_that_go_first_are_told(served: Served) -> None:
    said: list[str] = []
    for expected in ([], ["1 run before it"], ["2 runs before it"]):
        served.post("/runs", {"config": {"task": "reaching"}})
        say_place(served.dashboard, said.append)
        assert [line.split(";")[0] for line in said] == expected
        said.clear()
