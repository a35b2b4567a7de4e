"""`bpn-robot-sim`: one simulated robot with its camera. Actions in, frames out (`bpn_robot.service`)."""

from bpn_robot.service import serve
from bpn_robot_sim.probe import answer
from bpn_shared.bus import keys
from bpn_shared.runtime.entry import run_slot_worker


def main(argv: list[str] | None = None) -> int:
    """The robot service."""
    return run_slot_worker("robot_sim", __doc__, serve, argv, {keys.probe(): answer})
