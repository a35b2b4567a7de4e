"""A run that needs a GPU is refused where every connected learner has said that it has none."""

from collections.abc import Callable

from registry_world import Puppet, Registry, WaitFor

from bpn_dashboard.registry.workplace import ConnectedWorkers
from bpn_shared.messages.lease import Role
from bpn_shared.runs.creation import configure
from bpn_shared.spec.config import ConfigError


def test_only_what_learners_have_told_refuses_a_run(
    registry: Registry, hire: Callable[[Role], Puppet], wait_for: WaitFor
) -> None:
    assert registry.running is not None
    place = ConnectedWorkers(told=registry.running.desk.told)

    said: list[str] = []

    def allowed() -> bool:
        wanted = {"task": "reaching", "device": "cuda"}
        try:
            return configure(wanted, place).device == "cuda"
        except ConfigError as error:
            said.append(str(error))
            return False

    without, with_one, silent = hire("learner"), hire("learner"), hire("learner")
    assert allowed()  # nobody has said anything yet
    silent.ask()
    assert allowed()
    without.ask(gpu=False)
    assert not allowed()
    assert said == [
        "device = 'cuda': torch finds no GPU at any of the 1 connected learners; choose cpu"
    ]
    with_one.ask(gpu=True)
    assert allowed()
    with_one.bus.close()
    wait_for(lambda: not allowed(), "the learner with a GPU to be gone")
    without.bus.close()
    wait_for(allowed, "the last learner that has told to be gone")
