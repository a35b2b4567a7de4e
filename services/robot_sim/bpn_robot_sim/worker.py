"""`bpn-robot-sim`: one simulated robot with its camera. Actions in, frames out (`bpn_robot.service`)."""

from bpn_robot import service
from bpn_robot_sim.probe import answer
from bpn_robot_sim.robots import robot_for
from bpn_shared.bus import keys
from bpn_shared.runtime.entry import run_slot_worker
from bpn_shared.runtime.worker import Worker
from bpn_shared.spec.config import RunConfig


def serve(worker: Worker, config: RunConfig) -> int:
    """Plays the simulated robot of the run's task."""
    return service.serve(worker, config, robot_for)


def main(argv: list[str] | None = None) -> int:
    """The robot service."""
    return run_slot_worker("robot_sim", __doc__, serve, argv, {keys.probe(): answer})
