"""Every key expression of the system, in one place (the topic table is in ARCHITECTURE.md).

`ANY` in place of a part makes a pattern; who may do what at which key is in `bpn_shared.bus.access`. What robot
and edge of a slot say to each other has their site in its key: so a certificate can be good for one site alone.
"""

from typing import Literal
from uuid import UUID

from bpn_shared.site import MAIN_SITE

ANY: Literal["*"] = "*"
Run = UUID | Literal["*"]
Slot = int | Literal["*"]


def frame(run: Run, slot: Slot, site: str = MAIN_SITE) -> str:
    return f"bpn/{run}/robot/{site}/{slot}/frame"


def action(run: Run, slot: Slot, site: str = MAIN_SITE) -> str:
    return f"bpn/{run}/robot/{site}/{slot}/action"


def reset(run: Run, slot: Slot, site: str = MAIN_SITE) -> str:
    return f"bpn/{run}/robot/{site}/{slot}/reset"


def local_link(run: Run, slot: Slot, site: str, name: str) -> str:
    """Liveliness token of a robot: at which Unix socket an edge on its machine reaches it past the router."""
    return f"bpn/{run}/robot/{site}/{slot}/local/{name}"


def preview(run: Run, slot: Slot, site: str = MAIN_SITE) -> str:
    """What the network of this slot sees, for who watches."""
    return f"bpn/{run}/robot/{site}/{slot}/preview"


def decision(run: Run, slot: Slot, site: str = MAIN_SITE) -> str:
    """What the policy of this slot decided and why, for who watches."""
    return f"bpn/{run}/edge/{site}/{slot}/decision"


def next_episode(run: Run) -> str:
    return f"bpn/{run}/learner/next"


def episode(run: Run) -> str:
    return f"bpn/{run}/learner/episode"


def fault(run: Run) -> str:
    """Where an edge or a robot tells the learner that an episode cannot be had."""
    return f"bpn/{run}/learner/fault"


def config(run: Run) -> str:
    """Where the learner answers with the run's configuration: workers are told only run and slot."""
    return f"bpn/{run}/learner/config"


def rendezvous(run: Run) -> str:
    """Where a run's learner of rank 0 tells the others where the next update is."""
    return f"bpn/{run}/learner/rendezvous"


def weights(run: Run) -> str:
    return f"bpn/{run}/weights"


def metrics(run: Run, kind: str, worker: str) -> str:
    return f"bpn/{run}/metrics/{kind}/{worker}"


def log(run: Run, service: str) -> str:
    """Where a leased worker sends its log lines, for the run's learner to keep in the run folder."""
    return f"bpn/{run}/log/{service}"


def telemetry(kind: str, worker: str) -> str:
    """Where a service tells once a second how it is."""
    return f"bpn/telemetry/{kind}/{worker}"


def health(kind: str, worker: str) -> str:
    """Where a service answers what it does, what it waits for and its counters."""
    return f"bpn/health/{kind}/{worker}"


def live(kind: str, worker: str) -> str:
    """Liveliness token of a worker."""
    return f"bpn/live/{kind}/{worker}"


def worker_of(token: str) -> tuple[str, str]:
    """Kind and id of the worker that a key of `live` stands for."""
    *_, kind, worker = token.split("/")
    return kind, worker


def probe() -> str:
    """Where robot workers tell whether an environment can be a task."""
    return "bpn/robot_sim/probe"


def lease_request(site: str = MAIN_SITE) -> str:
    """Where the registry gives the idle workers of a site work."""
    return f"bpn/registry/lease/{site}"


LEASE_REQUEST_OF_EARLIER = "bpn/registry/lease"
"""Where workers of earlier protocols ask, to be told why they are of no use."""
LEASE_REQUESTS = f"{LEASE_REQUEST_OF_EARLIER}/**"
"""Where anyone asks."""


def serving(host: str, pid: str, name: str) -> str:
    """Liveliness token of the dashboard whose registry serves the router."""
    return f"bpn/registry/serving/{host}/{pid}/{name}"


def lease(run: Run, role: str, slot: Slot, worker: str) -> str:
    """Liveliness token of a worker at a place: what the registry knows of leases."""
    return f"bpn/lease/{run}/{role}/{slot}/{worker}"


def control(kind: str, worker: str) -> str:
    """Where a leased worker is told to let go."""
    return f"bpn/control/{kind}/{worker}"
