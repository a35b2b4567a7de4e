"""Which runs a query is about: some by their ids, or all that meet a filter."""

from collections.abc import Sequence

from bpn_dashboard.api.context import Context
from bpn_dashboard.api.filters import RunFilterQuery
from bpn_dashboard.api.problems import ApiError
from bpn_dashboard.database.tables import RunRow


def runs_of(parts: Context, ids: Sequence[str] | None, runs: RunFilterQuery | None) -> list[RunRow]:
    """The runs, oldest first if they are those of a filter.

    Raises:
        ApiError: neither or both are given.
        UnknownRunError: there is none of an id.
    """
    if (ids is None) == (runs is None):
        raise ApiError(422, "which-runs", "give either runs or filter")
    if ids is not None:
        return [parts.runs.get(run_id) for run_id in dict.fromkeys(ids)]
    assert runs is not None
    return parts.runs.find(runs.to_filter())
