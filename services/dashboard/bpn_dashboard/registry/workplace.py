"""The connected workers as the place where runs are done, as far as they can be asked before there is a run."""

from collections.abc import Callable, Sequence

from bpn_shared.bus.requests import NoReplyError
from bpn_shared.bus.session import Bus
from bpn_shared.messages.base import MessageError
from bpn_shared.messages.probe import ProbeReply, ProbeRequest
from bpn_shared.runtime.probing import probe_by_worker
from bpn_shared.spec.config import ConfigError, RunConfig


class ConnectedWorkers:
    """A `Workplace`: what workers have not told is not known, and no reason to refuse a run.

    Args:
        bus: the session through which they are reached; None: not reached yet.
        gpus: of the connected learners that have told, whether each has a GPU.
    """

    def __init__(
        self,
        bus: Callable[[], Bus | None] = lambda: None,
        gpus: Callable[[], Sequence[bool]] = tuple,
    ) -> None:
        self._bus, self._gpus = bus, gpus

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
        """See `Workplace.check`: a GPU."""
        gpus = self._gpus()
        if config.device == "cuda" and gpus and not any(gpus):
            raise ConfigError(
                f"device = 'cuda': torch finds no GPU at any of the {len(gpus)} connected learners; choose cpu"
            )
