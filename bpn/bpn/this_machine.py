"""This machine as the place where a run is done: what is missing is said before a run is made."""

import logging
from collections.abc import Collection

from bpn.terminal import stdout_for_results
from bpn_learner.callbacks.extras import check_extra
from bpn_shared import plugins
from bpn_shared.errors import InputError
from bpn_shared.messages.probe import ProbeReply, ProbeRequest
from bpn_shared.runtime.gym_modules import check_allowed
from bpn_shared.spec.config import ConfigError, RunConfig
from bpn_shared.spec.rewards import reward_function
from bpn_shared.spec.tasks import TaskSpec, is_gym

log = logging.getLogger(__name__)


class ThisMachine:
    """A `Workplace` that has all services in processes of its own.

    Args:
        gym_modules: what `gym:` tasks may import there.
    """

    def __init__(self, gym_modules: Collection[str] = ()) -> None:
        self._gym_modules = gym_modules

    def probe(self, asked: ProbeRequest) -> ProbeReply:
        """See `Workplace.probe`; what the environment prints goes to standard error."""
        from bpn_robot_sim.probe import probe_in_child  # noqa: PLC0415 - it takes a second to load

        found = probe_in_child(asked, self._gym_modules)
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
        from bpn_edge.kernel.choice import choose_kernel, kernels_here  # noqa: PLC0415

        load(choose_kernel(config.kernel, config.algorithm_spec.network, kernels_here()))
        plugins.find(plugins.SELECTIONS, config.policy)
        if is_gym(config.task):  # which was probed, or takes a while to make
            check_allowed(config.task, config, self._gym_modules)
        else:
            check_robot(config.task_spec)


def check_robot(task: TaskSpec) -> None:
    """Makes a robot of the task, as its worker will.

    Raises:
        ConfigError: it cannot be made here; the message says what to install or to set.
    """
    from bpn_robot.robots import make_robot  # noqa: PLC0415 - robots take a second to load

    try:
        # An OpenGL back end that is named but not there fails already here.
        with stdout_for_results():
            make_robot(task).close()
    except ConfigError:
        raise
    except (InputError, ImportError, RuntimeError, OSError) as error:
        raise ConfigError(f"task {task.name!r} cannot be played here: {error}") from error


def _check_learner(config: RunConfig) -> None:
    try:
        reward_function(config.task_spec)
    except InputError as error:
        raise ConfigError(f"task {config.task!r} cannot be learned here: {error}") from error
    plugins.find(plugins.TARGETS, config.algorithm_spec.targets)
    for name in config.callback_names:
        plugins.find(plugins.CALLBACKS, name)
        check_extra(name)
    if config.device == "cuda":
        from torch.cuda import is_available  # noqa: PLC0415 - it takes seconds to load

        if not is_available():
            raise ConfigError("device = 'cuda': torch finds no GPU on this machine; choose cpu")
