"""Every key expression of the system, in one place (the topic table is in ARCHITECTURE.md).

`ANY` in place of a part makes a pattern; who may do what at which key is in `bpn_shared.access`.
"""

from typing import Literal
from uuid import UUID

ANY: Literal["*"] = "*"
Run = UUID | Literal["*"]
Slot = int | Literal["*"]


def frame(run: Run, slot: Slot) -> str:
    return f"bpn/{run}/robot/{slot}/frame"


def action(run: Run, slot: Slot) -> str:
    return f"bpn/{run}/robot/{slot}/action"


def reset(run: Run, slot: Slot) -> str:
    return f"bpn/{run}/robot/{slot}/reset"


def preview(run: Run, slot: Slot) -> str:
    """What the network of this slot sees, for who watches."""
    return f"bpn/{run}/robot/{slot}/preview"


def decision(run: Run, slot: Slot) -> str:
    """What the policy of this slot decided and why, for who watches."""
    return f"bpn/{run}/edge/{slot}/decision"


def next_episode(run: Run) -> str:
    return f"bpn/{run}/learner/next"


def episode(run: Run) -> str:
    return f"bpn/{run}/learner/episode"


def config(run: Run) -> str:
    """Where the learner answers with the run's configuration: workers are told only run and slot."""
    return f"bpn/{run}/learner/config"


def weights(run: Run) -> str:
    return f"bpn/{run}/weights"


def metrics(run: Run, kind: str, worker: str) -> str:
    return f"bpn/{run}/metrics/{kind}/{worker}"


def telemetry(kind: str, worker: str) -> str:
    """Where a service tells once a second how it is."""
    return f"bpn/telemetry/{kind}/{worker}"


def health(kind: str, worker: str) -> str:
    """Where a service answers what it does, what it waits for and its counters."""
    return f"bpn/health/{kind}/{worker}"


def live(kind: str, worker: str) -> str:
    """Liveliness token of a worker."""
    return f"bpn/live/{kind}/{worker}"


def lease_request() -> str:
    """Where the registry answers an idle worker that asks what to work on."""
    return "bpn/registry/lease"


def lease(run: Run, role: str, slot: Slot, worker: str) -> str:
    """Liveliness token of a worker at its place in a run."""
    return f"bpn/lease/{run}/{role}/{slot}/{worker}"


def control(kind: str, worker: str) -> str:
    """Where a worker takes orders from the registry."""
    return f"bpn/control/{kind}/{worker}"
