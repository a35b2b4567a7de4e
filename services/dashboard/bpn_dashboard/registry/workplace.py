"""The connected workers as the place where runs are done, as far as they can be asked before there is a run."""

from collections.abc import Callable, Iterator, Sequence

from bpn_shared import plugins
from bpn_shared.bus.requests import NoReplyError
from bpn_shared.bus.session import Bus
from bpn_shared.messages.base import MessageError
from bpn_shared.messages.lease import LeaseRequest, Role
from bpn_shared.messages.probe import ProbeReply, ProbeRequest
from bpn_shared.plugins import Group
from bpn_shared.runtime.probing import probe_by_worker
from bpn_shared.spec.config import ConfigError, RunConfig


class ConnectedWorkers:
    """A `Workplace`: what workers have not told is not known, and no reason to refuse a run.

    Args:
        bus: the session through which they are reached; None: not reached yet.
        told: what connected workers have told of themselves.
    """

    def __init__(
        self,
        bus: Callable[[], Bus | None] = lambda: None,
        told: Callable[[], Sequence[LeaseRequest]] = tuple,
    ) -> None:
        self._bus, self._told = bus, told

    def probe(self, asked: ProbeRequest) -> ProbeReply | None:
        """See `Workplace.probe`."""
        bus = self._bus()
        if bus is None:
            return None
        try:
            return probe_by_worker(bus, asked)
        except NoReplyError:
            return None
        except MessageError as error:
            raise ConfigError(f"task = {asked.task!r}: a robot worker's answer: {error}") from error

    def check(self, config: RunConfig) -> None:
        """See `Workplace.check`: a GPU, and plug-ins that no worker has who would use them."""
        told = self._told()
        for group, name, role in _plugins_of(config):
            _check_plugin(group, name, role, told)
        gpus = [one.gpu for one in told if one.gpu is not None]
        if config.device == "cuda" and gpus and not any(gpus):
            raise ConfigError(
                f"device = 'cuda': torch finds no GPU at any of the {len(gpus)} connected learners; choose cpu"
            )


_NAMES: dict[Role, str] = {"learner": "learners", "edge": "edges", "robot_sim": "robots"}


def _plugins_of(config: RunConfig) -> Iterator[tuple[Group, str, Role]]:
    """What a run names, and who has to have it."""
    for name in config.callback_names:
        yield plugins.CALLBACKS, name, "learner"
    if config.task_spec.rewards is not None:
        yield plugins.REWARDS, config.task_spec.rewards, "learner"
    yield plugins.TARGETS, config.algorithm_spec.targets, "learner"
    yield plugins.SELECTIONS, config.policy, "edge"
    if config.kernel:  # else each edge chooses
        yield plugins.KERNELS, config.kernel, "edge"
    yield plugins.ROBOTS, config.task_spec.robot, "robot_sim"


def _check_plugin(group: Group, name: str, role: Role, told: Sequence[LeaseRequest]) -> None:
    have = [
        one.plugins[group.name] for one in told if one.role == role and group.name in one.plugins
    ]
    if not have or any(name in names for names in have):
        return
    there = ", ".join(sorted({n for names in have for n in names})) or "none"
    # An edge that was set up with kernels tells of those alone, whatever is installed.
    setting = (
        " (and set them up with it: --kernel or BPN_KERNEL)" if group == plugins.KERNELS else ""
    )
    raise ConfigError(
        f"{group.noun} {name!r} is not installed at any of the {len(have)} connected {_NAMES[role]}; there are: "
        f"{there}. Install the package that has it, or the extra that it needs, where they run{setting}; "
        "start them again"
    )
