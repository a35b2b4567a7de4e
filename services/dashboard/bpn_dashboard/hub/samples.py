"""How every service was over the last days: a sample of each now and then, few enough for any database."""

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from sqlalchemy import delete, func, select

from bpn_dashboard.database.engine import Database
from bpn_dashboard.database.watch_tables import SampleRow
from bpn_dashboard.hub.topology import Node, TopologySnapshot

log = logging.getLogger(__name__)

MOST_SERVICES = 200
"""In one answer; each restart of a service is another one."""
PERIOD_S = 15.0
KEPT_S = 7 * 86_400.0
MOST_ROWS = 500_000
"""Of all services together; the oldest go first."""
_TIDY_EVERY = 240


@dataclass(frozen=True)
class History:
    """One service over time; columns are equally long.

    Attributes:
        at: where each bucket begins, Unix seconds.
        cpu_percent, rss_bytes, messages_per_s, dropped_per_s: means over the bucket; None where nothing was told.
    """

    worker: str
    kind: str
    run: str | None
    slot: int | None
    host: str
    at: list[int]
    cpu_percent: list[float | None]
    rss_bytes: list[float | None]
    messages_per_s: list[float | None]
    dropped_per_s: list[float | None]


_VALUES = ("cpu_percent", "rss_bytes", "messages_per_s", "dropped_per_s")


class Samples:
    """Takes samples of what is told of services, and gives them back. Safe across threads."""

    def __init__(self, database: Database, topology: Callable[[], TopologySnapshot]) -> None:
        self._database, self._topology = database, topology
        self._taken = 0

    def take(self, now_s: float | None = None) -> int:
        """Stores how the services are now that tell it; returns how many that are."""
        at = int(time.time() if now_s is None else now_s)
        rows = [_sample(node, at) for node in self._topology().nodes if node.state == "live"]
        with self._database.writing() as session:
            for row in rows:
                session.merge(row)
            if self._taken % _TIDY_EVERY == 0:
                session.execute(delete(SampleRow).where(SampleRow.at < at - KEPT_S))
                newest = (
                    select(SampleRow.at).order_by(SampleRow.at.desc()).offset(MOST_ROWS).limit(1)
                )
                if (last := session.scalar(newest)) is not None:
                    session.execute(delete(SampleRow).where(SampleRow.at <= last))
        self._taken += 1
        return len(rows)

    def read(self, since_s: float, max_points: int) -> list[History]:
        """The services since then, in at most about so many buckets; of very many those that were there last.

        Args:
            since_s: Unix seconds.
        """
        now = int(time.time())
        width = max(int(PERIOD_S), -(-int(now - since_s) // max_points))
        bucket = SampleRow.at // width
        newest = (
            select(SampleRow.worker)
            .where(SampleRow.at >= since_s)
            .group_by(SampleRow.worker)
            .order_by(func.max(SampleRow.at).desc(), SampleRow.worker)
            .limit(MOST_SERVICES)
        )
        wanted = (
            select(
                SampleRow.worker, SampleRow.kind, SampleRow.run, SampleRow.slot, SampleRow.host,
                func.min(SampleRow.at), *(func.avg(getattr(SampleRow, name)) for name in _VALUES),
            )
            .where(SampleRow.at >= since_s, SampleRow.worker.in_(newest))
            .group_by(
                SampleRow.worker, SampleRow.kind, SampleRow.run, SampleRow.slot, SampleRow.host, bucket
            )
            .order_by(SampleRow.worker, func.min(SampleRow.at))
        )  # fmt: skip
        with self._database.reading() as session:
            rows = session.execute(wanted).all()
        found: dict[str, History] = {}
        for worker, kind, run, slot, host, at, *values in rows:
            # A worker changes its run: it is one line, called by what it does last.
            before = found.get(worker)
            moments: list[int] = before.at if before else []
            columns: list[list[float | None]] = [
                getattr(before, name) if before else [] for name in _VALUES
            ]
            moments.append(int(at))
            for column, value in zip(columns, values, strict=True):
                column.append(None if value is None else float(value))
            found[worker] = History(worker, kind, run, slot, host, moments, *columns)
        return list(found.values())

    def follow(self, stop: threading.Event) -> None:
        """Takes samples until `stop` is set."""
        while not stop.wait(PERIOD_S):
            try:
                self.take()
            except Exception as error:  # as of a full disk; the next sample may do
                log.info("services are not sampled now: %s", error)


def _sample(node: Node, at: int) -> SampleRow:
    flows = node.flows
    return SampleRow(
        worker=node.id,
        at=at,
        kind=node.kind,
        run=node.run,
        slot=node.slot,
        host=node.host,
        cpu_percent=node.cpu_percent,
        rss_bytes=node.rss_bytes,
        messages_per_s=sum(flow.messages_per_s for flow in flows),
        dropped_per_s=sum(flow.dropped_per_s for flow in flows),
    )
