"""Every key expression of the system, in one place (the topic table is in ARCHITECTURE.md)."""

from uuid import UUID


def frame(run: UUID, slot: int) -> str:
    return f"bpn/{run}/robot/{slot}/frame"


def action(run: UUID, slot: int) -> str:
    return f"bpn/{run}/robot/{slot}/action"


def reset(run: UUID, slot: int) -> str:
    return f"bpn/{run}/robot/{slot}/reset"


def preview(run: UUID, slot: int) -> str:
    """What the network of this slot sees, for who watches."""
    return f"bpn/{run}/robot/{slot}/preview"


def decision(run: UUID, slot: int) -> str:
    """What the policy of this slot decided and why, for who watches."""
    return f"bpn/{run}/edge/{slot}/decision"


def next_episode(run: UUID) -> str:
    return f"bpn/{run}/learner/next"


def episode(run: UUID) -> str:
    return f"bpn/{run}/learner/episode"


def config(run: UUID) -> str:
    """Where the learner answers with the run's configuration: workers are told only run and slot."""
    return f"bpn/{run}/learner/config"


def weights(run: UUID) -> str:
    return f"bpn/{run}/weights"


def metrics(run: UUID, kind: str, worker: str) -> str:
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
