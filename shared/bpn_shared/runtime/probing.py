"""Asking a robot worker whether an environment can be a task: whoever asks need not have it installed."""

from bpn_shared.bus import keys
from bpn_shared.bus.requests import RefusedError, request
from bpn_shared.bus.session import Bus
from bpn_shared.messages.probe import ProbeReply, ProbeRequest
from bpn_shared.spec.config import ConfigError

TIMEOUT_S = 60.0
"""Some environments load models or open a simulator."""


def probe_by_worker(
    bus: Bus, asked: ProbeRequest, *, timeout_s: float = TIMEOUT_S + 5.0
) -> ProbeReply:
    """What some robot worker, idle or not, finds out about the environment.

    Raises:
        ConfigError: the environment cannot be a task; the message is one sentence.
        NoReplyError: no robot worker answered within `timeout_s`.
        MessageError: the worker is of another version.
    """
    try:
        return ProbeReply.decode(request(bus, keys.probe(), asked.encode(), timeout_s=timeout_s))
    except RefusedError as error:
        raise ConfigError(str(error)) from error
