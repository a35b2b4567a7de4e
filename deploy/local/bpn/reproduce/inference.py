"""Target `inference`: the time of one inference on every kernel path, beside the paper's FPGA."""

from typing import Any

from matplotlib.figure import Figure

from bpn.bench import kernel
from bpn.plotting import colour, new_figure
from bpn.reproduce.definition import Context, Document, Scope, Target
from bpn.reproduce.markdown import table as markdown_table
from bpn_shared.config import RunConfig

PAPER_MS = {"DQN, FPGA (paper)": 1003.0, "BPN, FPGA (paper)": 4.0}
"""Table III: an Ultra96-V2, as Vivado HLS estimates it."""
_QUICK_ROUNDS = 1


def plan(scope: Scope) -> list[RunConfig]:
    """Needs no run: the time does not depend on the weights."""
    del scope
    return []


def measure(context: Context) -> dict[str, Any]:
    """What `bpn bench kernel` measures."""
    context.say("times every kernel path")
    return kernel.run(_QUICK_ROUNDS if context.scope.quick else kernel.ROUNDS)


def _times_ms(document: Document) -> dict[str, tuple[float, str]]:
    """Time and 99th percentile of each implementation, the slowest first."""
    ours = {
        name: (times["p50_us"] / 1e3, f"{times['p99_us'] / 1e3:.4f}")
        for name, times in document["result"]["candidates"].items()
    }
    papers = {name: (time_ms, "") for name, time_ms in PAPER_MS.items()}
    return dict(sorted((papers | ours).items(), key=lambda item: -item[1][0]))


def draw(document: Document) -> Figure:
    """One bar for each implementation; the scale is logarithmic."""
    times = _times_ms(document)
    figure, ((axes,),) = new_figure(1, 1, 8.0, 0.9 + 0.38 * len(times))
    for row, (name, (time_ms, _)) in enumerate(times.items()):
        axes.barh(row, time_ms, color=colour(1 if name in PAPER_MS else 0))
        axes.text(
            time_ms * 1.1,
            row,
            f"{_readable(time_ms)} ms",
            va="center",
            fontsize=8,
        )
    axes.set_yticks(range(len(times)), list(times))
    axes.set(xscale="log", xlabel="ms per inference", title=document["result"]["network"])
    axes.set_xlim(right=max(time_ms for time_ms, _ in times.values()) * 8)
    return figure


def _readable(time_ms: float) -> str:
    return f"{time_ms:.3g}" if time_ms < 100 else f"{time_ms:,.0f}"


def table(document: Document) -> str:
    """Every implementation, the fastest last."""
    binarized = document["result"]["candidates"]
    fastest_ms = min(times["p50_us"] for times in binarized.values()) / 1e3
    rows = [
        [name, _readable(time_ms), p99_ms, f"{time_ms / fastest_ms:,.1f}"]
        for name, (time_ms, p99_ms) in _times_ms(document).items()
    ]
    return markdown_table(["implementation", "p50 (ms)", "p99 (ms)", "x our fastest"], rows)


INFERENCE = Target(
    name="inference",
    title="Network inference time (the paper's Table III)",
    algorithms=(),
    plan=plan,
    measure=measure,
    draw=draw,
    table=table,
)
