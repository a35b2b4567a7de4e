"""`bpn-robot-sim`: one simulated robot with its camera. Actions in, frames out (`bpn_robot.service`)."""

from functools import partial

from bpn_robot.service import serve
from bpn_robot_sim.probe import answer
from bpn_shared import plugins
from bpn_shared.bus import keys
from bpn_shared.errors import InputError
from bpn_shared.runtime.entry import run_slot_worker, slot_options, slot_parser
from bpn_shared.runtime.gym_modules import add_gym_modules, allow_here, allowed_modules
from bpn_shared.runtime.leased import Abilities


def main(argv: list[str] | None = None) -> int:
    """The robot service."""
    parser = slot_parser("robot_sim", __doc__)
    add_gym_modules(parser)
    options = slot_options(parser, argv)
    try:
        allowed = allowed_modules(options.gym_modules)
    except InputError as error:
        parser.error(str(error))
    allow_here(allowed)
    return run_slot_worker(
        "robot_sim",
        options,
        serve,
        {keys.probe(): partial(answer, allowed=allowed)},
        Abilities(plugins={plugins.ROBOTS.name: plugins.names(plugins.ROBOTS)}),
    )
