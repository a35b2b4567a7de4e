"""Series at rest: chunks of raw points, each with its rollup.

A chunk holds the points of 4096 consecutive iterations, its rollup a bucket for every 64 of them. A coarse view
of a long series reads rollups alone; both are written together, so they never disagree. Runs have at
most 100,000 iterations: a coarser tier would save nothing.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence

from sqlalchemy import bindparam, delete, func, insert, select
from sqlalchemy.orm import Session

from bpn_dashboard.database.series_tables import ChunkRow, MetricRow, SourceRow
from bpn_dashboard.series.downsample import Buckets, bucketize
from bpn_dashboard.series.points import NO_POINTS, Points
from bpn_dashboard.series.summary import TAIL, take_tail, widen

CHUNK = 4096
ROLLUP = 64

ChunkKey = tuple[int, int]
_IDS_IN_A_STATEMENT = 500


def metrics_of(
    session: Session, run_ids: Sequence[str], names: Sequence[str] = ()
) -> list[MetricRow]:
    """The metrics of these runs that there are; of any name if none is given."""
    found: list[MetricRow] = []
    for ids in _batches(run_ids):
        wanted = select(MetricRow).where(MetricRow.run_id.in_(ids))
        if names:
            wanted = wanted.where(MetricRow.name.in_(names))
        found += session.scalars(wanted.order_by(MetricRow.run_id, MetricRow.name))
    return found


def read_points(
    session: Session, metric_ids: Sequence[int], first: float, last: float
) -> dict[int, Points]:
    """The points with first <= iteration <= last, of each series that has chunks there."""
    chunks: dict[int, list[Points]] = defaultdict(list)
    for ids in _batches(metric_ids):
        wanted = select(ChunkRow.metric_id, ChunkRow.first, ChunkRow.steps, ChunkRow.points).where(
            ChunkRow.metric_id.in_(ids), ChunkRow.part.between(first // CHUNK, last // CHUNK)
        )
        rows = session.execute(wanted.order_by(ChunkRow.metric_id, ChunkRow.part))
        for metric_id, start, steps, points in rows:
            chunks[metric_id].append(Points.from_bytes(start, steps, points))
    return {key: Points.joined(parts).between(first, last) for key, parts in chunks.items()}


def read_rollups(
    session: Session, metric_ids: Sequence[int], first: float, last: float
) -> dict[int, Buckets]:
    """The buckets of 64 iterations that touch [first, last], of each series that has chunks there."""
    chunks: dict[int, list[Buckets]] = defaultdict(list)
    for ids in _batches(metric_ids):
        wanted = select(ChunkRow.metric_id, ChunkRow.rollup).where(
            ChunkRow.metric_id.in_(ids), ChunkRow.part.between(first // CHUNK, last // CHUNK)
        )
        rows = session.execute(wanted.order_by(ChunkRow.metric_id, ChunkRow.part))
        for metric_id, rollup in rows:
            chunks[metric_id].append(Buckets.from_bytes(rollup))
    return {
        key: Buckets.joined(parts).between(first // ROLLUP * ROLLUP, last)
        for key, parts in chunks.items()
    }


def newest_revision(session: Session) -> int:
    """Of any series; 0 if there is none."""
    return session.scalar(select(func.max(MetricRow.revision))) or 0


def append(session: Session, run_id: str, columns: Mapping[str, Points]) -> None:
    """Adds points of one run; where an iteration was there already, the new value counts.

    Args:
        session: a writing one.
        run_id: the run.
        columns: by the metric's name, at least one point each.
    """
    metrics = _metric_rows(session, run_id, columns)
    pieces = {
        (metrics[name].id, part): new
        for name, points in columns.items()
        for part, new in points.split(CHUNK)
    }
    before = _read_chunks(session, pieces)
    after = {key: new.after(before.get(key, NO_POINTS)) for key, new in pieces.items()}
    _write_chunks(session, after)
    grown: dict[int, int] = defaultdict(int)
    for key, points in after.items():
        grown[key[0]] += len(points.steps) - len(before.get(key, NO_POINTS).steps)
    revision = newest_revision(session) + 1
    for name, points in columns.items():
        row = metrics[name]
        again = row.n > 0 and points.steps[0] <= row.last
        row.n += grown[row.id]
        row.first = min(row.first, int(points.steps[0]))
        row.last = max(row.last, int(points.steps[-1]))
        row.revision = revision
        _sum_up(session, row, points, after.get((row.id, row.last // CHUNK)), again=again)


def _sum_up(
    session: Session, row: MetricRow, new: Points, newest: Points | None, *, again: bool
) -> None:
    """Brings the row's summary up to date.

    Args:
        newest: the points of its last chunk, where they are at hand.
        again: some iterations of the new points had values before, which may have been extremes.
    """
    if again:
        row.lowest = row.highest = None
        widen(row, read_points(session, [row.id], 0, row.last)[row.id].values)
    else:
        widen(row, new.values)
    if newest is None or (len(newest.steps) < TAIL and row.last >= CHUNK):
        begin = (row.last // CHUNK - 1) * CHUNK
        newest = read_points(session, [row.id], max(begin, 0), row.last)[row.id]
    take_tail(row, newest.values[-TAIL:])


def forget(session: Session, run_id: str) -> None:
    """Removes a run's series, and what is remembered of its file."""
    ids = select(MetricRow.id).where(MetricRow.run_id == run_id)
    session.execute(delete(ChunkRow).where(ChunkRow.metric_id.in_(ids)))
    session.execute(delete(MetricRow).where(MetricRow.run_id == run_id))
    session.execute(delete(SourceRow).where(SourceRow.run_id == run_id))


def _metric_rows(
    session: Session, run_id: str, columns: Mapping[str, Points]
) -> dict[str, MetricRow]:
    rows = {row.name: row for row in metrics_of(session, [run_id])}
    for name in columns.keys() - rows.keys():
        first = int(columns[name].steps[0])
        rows[name] = MetricRow(run_id=run_id, name=name, n=0, first=first, last=first, revision=0)
        session.add(rows[name])
    session.flush()  # they get their ids
    return rows


def _read_chunks(session: Session, keys: Mapping[ChunkKey, Points]) -> dict[ChunkKey, Points]:
    parts = [part for _, part in keys]
    columns = (ChunkRow.metric_id, ChunkRow.part, ChunkRow.first, ChunkRow.steps, ChunkRow.points)
    found: dict[ChunkKey, Points] = {}
    for ids in _batches(sorted({metric_id for metric_id, _ in keys})):
        wanted = select(*columns).where(
            ChunkRow.metric_id.in_(ids), ChunkRow.part.between(min(parts), max(parts))
        )
        for metric_id, part, first, steps, points in session.execute(wanted):
            found[metric_id, part] = Points.from_bytes(first, steps, points)
    return found


def _write_chunks(session: Session, chunks: Mapping[ChunkKey, Points]) -> None:
    rows = []
    for (metric_id, part), points in chunks.items():
        first, steps, values = points.to_bytes()
        rows.append(
            {
                "metric_id": metric_id,
                "part": part,
                "first": first,
                "rollup": bucketize(points.steps.astype("f8"), points.values, ROLLUP).to_bytes(),
                "steps": steps,
                "points": values,
            }
        )
    connection = session.connection()
    keys = [{"key_metric": row["metric_id"], "key_part": row["part"]} for row in rows]
    connection.execute(
        delete(ChunkRow).where(
            ChunkRow.metric_id == bindparam("key_metric"), ChunkRow.part == bindparam("key_part")
        ),
        keys,
    )
    connection.execute(insert(ChunkRow), rows)


def _batches(ids: Sequence[int] | Sequence[str]) -> Iterator[Sequence[int] | Sequence[str]]:
    for begin in range(0, len(ids), _IDS_IN_A_STATEMENT):
        yield ids[begin : begin + _IDS_IN_A_STATEMENT]
