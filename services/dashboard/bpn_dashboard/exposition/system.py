"""What runs and workers need: a registry that serves, disk, certificates; and what the dashboard itself counts."""

import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path

from prometheus_client.core import InfoMetricFamily
from prometheus_client.metrics_core import Metric

from bpn_dashboard.certificates import Certificate
from bpn_dashboard.exposition.families import counter, gauge
from bpn_shared.version import PROTOCOL, VERSION


def program(counts: Mapping[str, int]) -> Iterator[Metric]:
    """Which program the dashboard is, and what it counted."""
    build = InfoMetricFamily("bpn_build", "The dashboard's program.", labels=[])
    build.add_metric([], {"version": VERSION, "protocol": str(PROTOCOL)})
    yield build
    events = [((event,), count) for event, count in counts.items()]
    yield counter("bpn_dashboard_events", "What the dashboard counted.", ["event"], events)


def registry(*, serves: bool, unreadable_folders: int) -> Iterator[Metric]:
    """Whether workers are given work, and what keeps runs from being shown."""
    yield gauge(
        "bpn_registry_serving", "1: this dashboard gives workers work.", [], [((), float(serves))]
    )
    yield gauge(
        "bpn_run_folders_unreadable", "Folders that should be runs' and cannot be read.", [],
        [((), unreadable_folders)],
    )  # fmt: skip


def disks(folders: Mapping[str, Path]) -> Iterator[Metric]:
    """Of the disks on which these folders are.

    Args:
        folders: by what they are called in the label.
    """
    usages = {}
    for name, folder in folders.items():
        with suppress(OSError):  # it is not there yet, or its disk is away
            usages[name] = shutil.disk_usage(folder)
    free = [((name,), usage.free) for name, usage in usages.items()]
    size = [((name,), usage.total) for name, usage in usages.items()]
    yield gauge("bpn_disk_free_bytes", "Room left on a folder's disk.", ["folder"], free)
    yield gauge("bpn_disk_size_bytes", "Size of a folder's disk.", ["folder"], size)


def certificates(known: Iterable[Certificate]) -> Iterator[Metric]:
    """How long certificates are good."""
    now, known = datetime.now(UTC), list(known)
    labels = ["kind", "worker"]
    yield gauge(
        "bpn_certificate_days_left", "Until a certificate ends; below 0: it has.", labels,
        [((c.kind, c.id), c.days_left(now)) for c in known],
    )  # fmt: skip
    yield gauge(
        "bpn_certificate_life_days", "From its beginning to its end.", labels,
        [((c.kind, c.id), (c.life.end - c.life.start) / timedelta(days=1)) for c in known],
    )  # fmt: skip
