"""This machine as the place where a run is done: what is missing is said before a run is made."""

import logging
from importlib.util import find_spec

from bpn.terminal import stdout_for_results
from bpn_shared import plugins
from bpn_shared.messages.probe import ProbeReply, ProbeRequest
from bpn_shared.spec.config import ConfigError, RunConfig
from bpn_shared.spec.tasks import is_gym

log = logging.getLogger(__name__)


class ThisMachine:
    """A `Workplace` that has all services in processes of its own."""

    def probe(self, asked: ProbeRequest) -> ProbeReply:
        """See `Workplace.probe`; what the environment prints goes to standard error."""
        from bpn_robot_sim.probe import probe_in_child  # noqa: PLC0415 - it takes a second to load

        found = probe_in_child(asked)
        if found.note:
            log.warning("%s", found.note)
        return found

    def check(self, config: RunConfig) -> None:
        """See `Workplace.check`: kernel, GPU, callbacks, and OpenGL where MuJoCo renders."""
        _check_learner(config)
        self.check_playing(config)

    def check_playing(self, config: RunConfig) -> None:
        """Refuses what robots and edges of this machine cannot do, whatever the learner needs.

        Raises:
            ConfigError: something is missing; the message names it and the remedy.
        """
        from bpn_edge.kernel import load  # noqa: PLC0415 - it takes a second to load

        load(config.kernel)
        if not is_gym(config.task):
            check_rendering(config.task)


def check_rendering(task: str) -> None:
    """Makes a robot of the task and renders it once.

    Raises:
        ConfigError: it cannot be rendered here; the message says what to install or to set.
    """
    try:
        # An OpenGL back end that is named but not there fails already here.
        from bpn_robot_sim.robots import make_robot  # noqa: PLC0415

        with stdout_for_results():
            make_robot(task).close()
    except (ImportError, RuntimeError, OSError) as error:
        raise ConfigError(f"task {task!r} cannot be simulated here: {error}") from error


def _check_learner(config: RunConfig) -> None:
    if config.tensorboard and find_spec("tensorboard") is None:
        raise ConfigError(
            "tensorboard = True needs tensorboard, which is not installed: "
            "pip install 'bpn-learner[tensorboard]'"
        )
    for name in config.callback_names:
        plugins.find(plugins.CALLBACKS, name)
    if config.device == "cuda":
        from torch.cuda import is_available  # noqa: PLC0415 - it takes seconds to load

        if not is_available():
            raise ConfigError("device = 'cuda': torch finds no GPU on this machine; choose cpu")
