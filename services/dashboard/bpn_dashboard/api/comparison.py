"""Groups of runs compared: one score for each seed, with intervals, tests and a conclusion in words."""

from typing import Annotated, Any, Literal

import numpy as np
import orjson
from fastapi import APIRouter, Response
from pydantic import BaseModel, Field

from bpn_dashboard.api.configs import ConfigKey
from bpn_dashboard.api.configs import Request as Body
from bpn_dashboard.api.context import Context, Parts, Viewer
from bpn_dashboard.api.filters import RunFilterQuery
from bpn_dashboard.api.groups import Group, group_runs
from bpn_dashboard.api.models import MAX_IDS, MetricName, RunId
from bpn_dashboard.api.problems import ApiError, responses
from bpn_dashboard.api.subject import runs_of
from bpn_dashboard.comparison.episodes import edges_of, newest_returns, shares
from bpn_dashboard.comparison.scores import ScoredRun, Scores
from bpn_dashboard.comparison.summary import GroupSummary, compare
from bpn_dashboard.comparison.verdicts import sentence
from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.series.summary import Value
from bpn_shared.runs.comparison import Interval
from bpn_shared.runs.statistics import Floats
from bpn_shared.spec.tasks import RETURN, RETURN_PX

router = APIRouter(tags=["series"])

MOST_GROUPS = 100
_MOST_READ = 300
_VALUE_WORDS: dict[Value, str] = {
    "last": "the newest", "highest": "the highest", "lowest": "the lowest",
    "mean_5": "the mean of the last 5", "mean_20": "the mean of the last 20",
    "mean_100": "the mean of the last 100",
}  # fmt: skip


_METRIC_WORDS = {RETURN: "returns", RETURN_PX: "returns"}


class _Groups(Body):
    runs: Annotated[list[RunId], Field(max_length=MAX_IDS)] | None = None
    filter: RunFilterQuery | None = None
    group_by: Annotated[
        Annotated[list[ConfigKey], Field(max_length=20)] | Literal["all_but_seed"] | None,
        Field(description="runs alike in these keys form one group; null: every run for itself"),
    ] = "all_but_seed"


class ComparisonQuery(_Groups):
    """What to compare. Either `runs` or `filter` says of which runs."""

    metric: Annotated[
        MetricName | None, Field(description="null: the return, as the runs' task has it")
    ] = None
    value: Annotated[Value, Field(description="what of a run's metric is its score")] = "mean_5"
    higher_is_better: bool = True
    baseline: Annotated[
        Annotated[str, Field(max_length=200)] | None,
        Field(description="key of the group that the others are compared with; null: the first"),
    ] = None


class Spread(BaseModel):
    """A value with its 95 % interval (stratified percentile bootstrap); null where there is none."""

    value: float | None
    low: float | None
    high: float | None


class SeedShown(BaseModel):
    """A seed's score: the mean over its runs, which are one sample."""

    seed: int
    task: str
    score: float
    run_ids: list[str]


class AgainstShown(BaseModel):
    """A group beside the baseline."""

    difference: Annotated[
        Spread, Field(description="of interquartile means: this one's less the baseline's")
    ]
    improvement: Annotated[
        Spread, Field(description="probability that a seed is better than one of the baseline's")
    ]
    p: Annotated[
        float, Field(description="two-sided rank-sum test, after Holm's correction for all groups")
    ]
    verdict: Literal["better", "worse", "unclear", "too few seeds"]
    sentence: str


class ProfileShown(BaseModel):
    """Of each threshold the share of seeds that score above it, with its 95 % interval."""

    share: list[float]
    low: list[float | None]
    high: list[float | None]


class GroupShown(BaseModel):
    """What a group came to."""

    key: str
    label: str
    group: dict[str, Any]
    runs: int
    seeds: Annotated[
        int, Field(description="the sample size; fewer than runs: duplicates count once")
    ]
    missing: Annotated[int, Field(description="seeds without a finite score, left out")]
    scores: list[SeedShown]
    mean: float | None
    std: Annotated[float | None, Field(description="the sample's (n - 1), over seeds")]
    iqm: Spread
    success: Annotated[
        Spread, Field(description="share of successful episodes, where it is defined")
    ]
    profile: ProfileShown | None
    against: AgainstShown | None


class ComparisonAnswer(BaseModel):
    """Groups in order of their oldest runs."""

    metric: str
    value: str
    higher_is_better: bool
    baseline: Annotated[str | None, Field(description="the group's key")]
    conclusion: Annotated[
        str, Field(description="of the group furthest from the baseline, or what is missing")
    ]
    thresholds: list[float]
    groups: list[GroupShown]


@router.post(
    "/comparison",
    operation_id="compareGroups",
    responses=responses(404, 422) | {200: {"model": ComparisonAnswer}},
)
def compare_groups(_who: Viewer, parts: Parts, body: ComparisonQuery) -> Response:
    """Compares groups of runs by one score for each seed; nothing is drawn at random anew."""
    rows = runs_of(parts, body.runs, body.filter)
    groups = _checked(group_runs(rows, body.group_by))
    metric = body.metric or (rows[0].return_metric if rows else RETURN)
    answer = _answer(parts, body, {row.id: row for row in rows}, groups, metric)
    data = orjson.dumps(answer, option=orjson.OPT_SERIALIZE_NUMPY)  # NaN becomes null
    return Response(data, media_type="application/json")


def _answer(
    parts: Context, body: ComparisonQuery, rows: dict[str, RunRow], groups: list[Group], metric: str
) -> dict[str, Any]:
    shown: dict[str, Any] = {
        "metric": metric, "value": body.value, "higher_is_better": body.higher_is_better,
        "baseline": None, "conclusion": "No run meets this.", "thresholds": [], "groups": [],
    }  # fmt: skip
    if not groups:
        return shown
    keys = [group.key for group in groups]
    if body.baseline is not None and body.baseline not in keys:
        raise ApiError(422, "baseline", f"no group has the key {body.baseline!r}")
    baseline = keys.index(body.baseline) if body.baseline else 0
    values = parts.series.values(list(rows), metric, body.value)
    successes = _successes(parts, list(rows), body.value)
    found = compare(
        [_scores(group, rows, values) for group in groups],
        [_scores(group, rows, successes) for group in groups],
        baseline,
        higher_is_better=body.higher_is_better,
    )
    sentences = _sentences(
        groups,
        found.groups,
        baseline,
        f"{_VALUE_WORDS[body.value]} {_METRIC_WORDS.get(metric, metric)}",
    )
    return shown | {
        "baseline": groups[baseline].key,
        "conclusion": _conclusion(found.groups, sentences),
        "thresholds": found.thresholds,
        "groups": [_group(*three) for three in zip(groups, found.groups, sentences, strict=True)],
    }


def _scores(group: Group, rows: dict[str, RunRow], values: dict[str, float]) -> Scores:
    return Scores.of(
        [
            ScoredRun(run_id, seed, rows[run_id].task, values.get(run_id))
            for run_id, seed in group.seeds.items()
        ]
    )


def _successes(parts: Context, run_ids: list[str], value: Value) -> dict[str, float]:
    """Shares of successful episodes: of evaluations where there are any, else of what was learned from."""
    evaluated = parts.series.values(run_ids, "eval_success", value)
    successes = parts.series.values(run_ids, "successes", value)
    episodes = parts.series.values(run_ids, "episodes", value)
    trained = {
        run_id: successes[run_id] / episodes[run_id]
        for run_id in successes.keys() & episodes.keys()
        if episodes[run_id] > 0
    }
    return trained | evaluated


def _sentences(
    groups: list[Group], found: list[GroupSummary], baseline: int, measure: str
) -> list[str]:
    tests = sum(group.against is not None for group in found)
    return [
        ""
        if one.against is None
        else sentence(
            *_names(group, groups[baseline]), one.against, measure=measure, tests=tests,
            sizes=(len(one.scores.seeds), len(found[baseline].scores.seeds)),
        )
        for group, one in zip(groups, found, strict=True)
    ]  # fmt: skip


def _names(group: Group, baseline: Group) -> tuple[str, str]:
    """What the two are called where only they are spoken of: by the values in which they differ."""
    differing = [
        key for key, value in group.values.items() if value != baseline.values.get(key, value)
    ]
    if not differing:
        return group.label, baseline.label
    one, other = (
        " ".join(f"{key}={values[key]}" for key in differing)
        for values in (group.values, baseline.values)
    )
    return one, other


def _conclusion(found: list[GroupSummary], sentences: list[str]) -> str:
    compared = [place for place, one in enumerate(found) if one.against is not None]
    if not any(one.scores.seeds for one in found):
        return "No run has a value of this yet."
    if not compared:
        return "There is nothing to compare it with: one group has values."

    def clearness(place: int) -> tuple[float, float]:
        against = found[place].against
        assert against is not None
        return against.p, -abs(against.improvement.value - 0.5)

    return sentences[min(compared, key=clearness)]


def _spread(interval: Interval) -> dict[str, float]:
    return {"value": interval.value, "low": interval.low, "high": interval.high}


def _group(group: Group, found: GroupSummary, words: str) -> dict[str, Any]:
    against, profile = found.against, found.profile
    return {
        "key": group.key,
        "label": group.label,
        "group": group.values,
        "runs": found.scores.runs,
        "seeds": len(found.scores.seeds),
        "missing": found.scores.missing,
        "scores": [
            {"seed": one.seed, "task": one.stratum, "score": one.score, "run_ids": one.run_ids}
            for one in found.scores.seeds
        ],
        "mean": found.mean,
        "std": found.std,
        "iqm": _spread(found.iqm),
        "success": _spread(found.success),
        "profile": profile and {"share": profile.share, "low": profile.low, "high": profile.high},
        "against": against
        and {
            "difference": _spread(against.difference),
            "improvement": _spread(against.improvement),
            "p": against.p,
            "verdict": against.verdict,
            "sentence": words,
        },
    }


class EpisodesQuery(_Groups):
    """Whose episodes. Either `runs` or `filter` says of which runs."""

    iterations: Annotated[int, Field(ge=1, le=100, description="the newest of each run")] = 5


class EpisodesOfGroup(BaseModel):
    """The distribution of a group's episode returns."""

    key: str
    label: str
    episodes: int
    seeds: int
    shares: Annotated[
        list[float], Field(description="of the episodes in each bin; seeds weigh the same")
    ]


class EpisodesAnswer(BaseModel):
    """Distributions over the same bins."""

    edges: Annotated[list[float], Field(description="of the bins, one more than there are")]
    runs: Annotated[int, Field(description="whose episodes were read: the newest, at most 300")]
    total: Annotated[int, Field(description="that there are")]
    groups: list[EpisodesOfGroup]


@router.post("/comparison/episodes", operation_id="compareEpisodes", responses=responses(404, 422))
def compare_episodes(_who: Viewer, parts: Parts, body: EpisodesQuery) -> EpisodesAnswer:
    """How the returns of single episodes are distributed in each group."""
    rows = runs_of(parts, body.runs, body.filter)
    groups = _checked(group_runs(rows, body.group_by))
    read = {row.id for row in rows[-_MOST_READ:]}
    returns = []
    for group in groups:
        by_seed: dict[int, list[Floats]] = {}
        for run_id, seed in group.seeds.items():
            if run_id in read:
                found = newest_returns(parts.runs.runs_dir, run_id, body.iterations)
                by_seed.setdefault(seed, []).append(found)
        returns.append([np.concatenate(of_one) for of_one in by_seed.values()])
    edges = edges_of([np.concatenate(of_group) for of_group in returns if of_group])
    return EpisodesAnswer(
        edges=edges.tolist(),
        runs=len(read),
        total=len(rows),
        groups=[
            EpisodesOfGroup(
                key=group.key,
                label=group.label,
                episodes=sum(map(len, of_group)),
                seeds=sum(len(values) > 0 for values in of_group),
                shares=shares(of_group, edges).tolist(),
            )
            for group, of_group in zip(groups, returns, strict=True)
        ],
    )


def _checked(groups: list[Group]) -> list[Group]:
    if len(groups) > MOST_GROUPS:
        raise ApiError(
            422, "too-many-curves",
            f"{len(groups)} groups cannot be compared with each other: the limit is {MOST_GROUPS}. Filter, or "
            "group by fewer keys",
        )  # fmt: skip
    return groups
