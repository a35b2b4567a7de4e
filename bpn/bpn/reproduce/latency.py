"""Target `latency`: from image to action on each computer, and what latency costs a policy."""

from math import prod
from textwrap import fill
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bpn.evaluation.outcome import outcome, summarize
from bpn.evaluation.trials import TrialPlan
from bpn.plotting import colour, entitle, new_figure
from bpn.reproduce import computers
from bpn.reproduce.caption import caption
from bpn.reproduce.definition import Context, Document, Scope, Target
from bpn.reproduce.markdown import mean_and_range
from bpn.reproduce.markdown import table as markdown_table
from bpn.reproduce.remote_policy import CONFIG
from bpn.reproduce.statistics import count, group, of_seeds
from bpn.summary import percentiles
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import RunConfig

DELAYS_MS = (0, 4, 21, 38, 100, 1003)
"""Those of the paper's Tables III and IV: edge FPGA, edge CPU, server, and a float network on the FPGA."""
PAPER_MS = {
    computers.EDGE: ("", "4", "", "4"),
    computers.EDGE_CPU: ("", "21", "", "21"),
    computers.SERVER: ("34", "2", "2", "38"),
}
"""Table IV: send, compute, receive, total."""
RUNNING = "edge in the running system, over the bus"
LINKS_MBIT_PER_S = (10, 100, 1000)

_IMAGES, _QUICK_IMAGES = 100, 5
_TRIALS, _ROBOTS = 12, 4
_QUICK_DELAYS_MS, _QUICK_TRIALS = (0, 1003), 2
_START_SEED = 4
"""Of the trials' starts, which are the same for every delay and run."""


def plan(scope: Scope) -> list[RunConfig]:
    """BPN on tracking, as the target `tracking` has it."""
    return scope.configs("tracking")


def measure(context: Context) -> dict[str, Any]:
    """Both halves.

    Returns:
        computers: see `computers.measure`; image_bytes: what the server gets; camera_to_action_us: {p50, p99}
        in the running system without added delay; trials: for each run and delay algorithm, seed,
        delay_ms and the evaluation's summary.
    """
    quick = context.scope.quick
    context.say("times every computer, one image in a control period")
    found = computers.measure(_QUICK_IMAGES if quick else _IMAGES, context.stop)
    played, loop_us = [], []
    for folder in context.runs:
        for delay_ms in _QUICK_DELAYS_MS if quick else DELAYS_MS:
            context.say(f"plays with {delay_ms} ms added (seed {folder.config().seed})")
            summary, times_us = _play(context, folder, delay_ms)
            played.append(summary)
            loop_us += times_us if delay_ms == 0 else []
    return {
        "computers": found,
        "image_bytes": prod(CONFIG.task_spec.frame_shape),
        "camera_to_action_us": percentiles(np.array(loop_us)),
        "trials": played,
    }


def _play(
    context: Context, folder: RunFolder, delay_ms: float
) -> tuple[dict[str, Any], list[float]]:
    count = _QUICK_TRIALS if context.scope.quick else _TRIALS
    changes = {"pacing": "realtime", "action_delay_ms": delay_ms, "robots": min(_ROBOTS, count)}
    trials = TrialPlan(count, "greedy", _START_SEED, changes)
    config, episodes = trials.config(folder.config()), context.play(folder, trials)
    summary = summarize(config, [outcome(config, episode) for episode in episodes])
    times_ns = np.concatenate([episode.camera_to_action_ns for episode in episodes])
    name = {"algorithm": config.algorithm, "seed": folder.config().seed, "delay_ms": delay_ms}
    return {**name, **summary}, (times_ns[times_ns > 0] / 1e3).tolist()


def draw(document: Document) -> Figure:
    """The computers' times beside the paper's; below, the share of kept targets for every added delay."""
    figure, ((above,), (below,)) = new_figure(2, 1, 7.4, 7.0)
    _computers(above, document["result"])
    _delays(below, document["result"]["trials"])
    how = "above: p50; below: mean over seeds, and each seed"
    entitle(figure, document["title"], of=caption(document, how), legend=(above, below))
    return figure


def _computers(axes: Axes, result: dict[str, Any]) -> None:
    times = {name: parts["total_us"]["p50"] / 1e3 for name, parts in result["computers"].items()}
    if result["camera_to_action_us"]["p50"] is not None:
        times[RUNNING] = result["camera_to_action_us"]["p50"] / 1e3
    slowest_ms = max(times.values())
    for row, (name, time_ms) in enumerate(reversed(times.items())):
        axes.plot(time_ms, row, "o", color=colour(0), label="this machine, without a network")
        axes.text(time_ms * 1.15, row, f"{time_ms:.3g} ms", va="center", fontsize=8)
        if name in PAPER_MS:
            paper_ms = float(PAPER_MS[name][-1])
            slowest_ms = max(slowest_ms, paper_ms)
            axes.plot(paper_ms, row, "D", color=colour(1), label="the paper's machines")
    axes.set_yticks(range(len(times)), [fill(name, 22) for name in reversed(times)])
    axes.set(xscale="log", xlabel="ms from image to action, one image a control period")
    axes.set_xlim(min(times.values()) / 2, slowest_ms * 2)


def _delays(axes: Axes, trials: list[dict[str, Any]]) -> None:
    by_delay = group(trials, "delay_ms")
    shares = [_success_shares(trials) for trials in by_delay.values()]
    trials_each = next(iter(by_delay.values()))[0]["trials"]
    for x, of_delay in enumerate(shares):
        axes.plot(x, of_delay.mean(), "o", color=colour(0), markersize=9, label="mean over seeds")
        each = f"one seed, {trials_each} trials"
        axes.plot([x] * len(of_delay), of_delay, "_", color=colour(1), markersize=14, label=each)
    axes.set_xticks(range(len(shares)), [f"{delay_ms:g}" for (delay_ms,) in by_delay])
    axes.set(
        xlabel="delay added between frame and action (ms)",
        ylabel="share of trials\nthat keep the target",
        ylim=(-0.05, 1.05),
    )
    axes.set_title("tracking in realtime pacing, 145 ms period", fontsize=10)


def _success_shares(trials: list[dict[str, Any]]) -> npt.NDArray[np.float64]:
    return of_seeds(trials, [of_seed["success_share"] for of_seed in trials])


def table(document: Document) -> str:
    """Two tables: the computers, and the delays."""
    notes = (
        "In brackets above: the paper's machines; below: from the lowest to the highest seed. The running "
        f"system has {_ROBOTS} robots at once, whose processes share {document['machine']['cores']} cores."
    )
    return f"{_computer_table(document)}\n\n{_delay_table(document)}\n\n{notes}"


def _computer_table(document: Document) -> str:
    result = document["result"]
    rows = []
    for name, parts in result["computers"].items():
        ours = [parts[part]["p50"] for part in ("send_us", "compute_us", "receive_us", "total_us")]
        cells = [
            ""
            if time_us == 0
            else f"{time_us / 1e3:.3f} ({paper})"
            if paper
            else f"{time_us / 1e3:.3f}"
            for time_us, paper in zip(ours, PAPER_MS.get(name, [""] * 4), strict=True)
        ]
        rows.append([name, *cells, f"{parts['total_us']['p99'] / 1e3:.3f}"])
    for rate in LINKS_MBIT_PER_S:
        wire_ms = result["image_bytes"] * 8 / (rate * 1e3)
        total_ms = wire_ms + result["computers"][computers.SERVER]["total_us"]["p50"] / 1e3
        rows.append(
            [
                f"server behind {rate} Mbit/s (computed)",
                f"+ {wire_ms:.2f}",
                "",
                "",
                f"{total_ms:.2f}",
                "",
            ]
        )
    loop = result["camera_to_action_us"]
    if loop["p50"] is not None:
        times = (f"{loop[key] / 1e3:.3f}" for key in ("p50", "p99"))
        rows.append([RUNNING, "", "", "", *times])
    heading = ["ms, p50 (paper)", "send image", "compute", "send action", "total", "total p99"]
    return markdown_table(heading, rows)


def _delay_table(document: Document) -> str:
    rows = []
    for (delay_ms,), seeds in group(document["result"]["trials"], "delay_ms").items():
        rows.append(
            [
                f"{delay_ms:g}", count(seeds), sum(trials["trials"] for trials in seeds),
                mean_and_range(100 * _success_shares(seeds), "{:.0f}"),
                f"{np.mean([t['length']['mean'] for t in seeds]):.1f}",
                f"{np.mean([t['px_per_step']['mean'] for t in seeds]):.1f}",
                f"{np.mean([t['return_px']['mean'] for t in seeds]):.1f}",
            ]
        )  # fmt: skip
    heading = [
        "added delay (ms)", "seeds", "trials", "keep the target (%)", "steps", "px a step", "return (px)",
    ]  # fmt: skip
    return markdown_table(heading, rows)


LATENCY = Target(
    name="latency",
    title="Latency from image to action, and its cost (the paper's Table IV)",
    algorithms=("bpn",),
    plan=plan,
    measure=measure,
    draw=draw,
    table=table,
)
