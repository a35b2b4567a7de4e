"""`bpn-robot-sim`: one simulated robot with its camera. Actions in, frames out (`bpn_robot.service`)."""

from collections.abc import Collection
from functools import partial

from bpn_robot import service
from bpn_robot_sim.probe import answer
from bpn_robot_sim.robots import robot_for
from bpn_shared.bus import keys
from bpn_shared.errors import InputError
from bpn_shared.runtime.entry import run_slot_worker, slot_options, slot_parser
from bpn_shared.runtime.gym_modules import add_gym_modules, allowed_modules
from bpn_shared.runtime.worker import Worker
from bpn_shared.spec.config import RunConfig


def serve(worker: Worker, config: RunConfig, allowed: Collection[str] = ()) -> int:
    """Plays the simulated robot of the run's task; `allowed`: modules that `gym:` tasks may import."""
    return service.serve(worker, config, partial(robot_for, allowed=allowed))


def main(argv: list[str] | None = None) -> int:
    """The robot service."""
    parser = slot_parser("robot_sim", __doc__)
    add_gym_modules(parser)
    options = slot_options(parser, argv)
    try:
        allowed = allowed_modules(options.gym_modules)
    except InputError as error:
        parser.error(str(error))
    return run_slot_worker(
        "robot_sim",
        options,
        partial(serve, allowed=allowed),
        {keys.probe(): partial(answer, allowed=allowed)},
    )
