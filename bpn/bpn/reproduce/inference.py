"""Target `inference`: the time of one inference on every kernel path, beside the paper's FPGA."""

from dataclasses import asdict
from typing import Any

from matplotlib.figure import Figure

from bpn.bench import kernel
from bpn.fpga import clocks
from bpn.fpga.report import NOMINAL_MHZ
from bpn.plotting import colour, entitle, new_figure
from bpn.reproduce.caption import caption
from bpn.reproduce.definition import Context, Document, Scope, Target
from bpn.reproduce.markdown import table as markdown_table
from bpn_edge.fpga.build import Build
from bpn_shared.spec.config import ConfigError, RunConfig

PAPER_MS = {"DQN, FPGA (paper)": 1003.0, "BPN, FPGA (paper)": 4.0}
"""Table III: an Ultra96-V2, as Vivado HLS estimates it."""
RTL = f"RTL, {NOMINAL_MHZ} MHz (simulated)"
_PAPER = "the paper's FPGA: an estimate for another machine"
_CIRCUIT = "clocks of the RTL, counted in simulation"
_NOTE = (
    "One inference after the other, with everything in the caches. With one image in a control period, as a "
    "robot has it, they take longer: [latency](latency.md). The paper's times are estimates for an FPGA, the "
    "others are of a server's processor: two machines, not two implementations."
)
_RTL_NOTE = " The RTL's is from the first pixels to the outputs, 32 bits of pixels a clock: [how](../fpga.md)."
_QUICK_ROUNDS = 1


def plan(scope: Scope) -> list[RunConfig]:
    """Needs no run: the time does not depend on the weights."""
    del scope
    return []


def measure(context: Context) -> dict[str, Any]:
    """What `bpn bench kernel` measures; and the clocks of the RTL, where there is a simulator."""
    context.say("times every kernel path")
    result = kernel.run(_QUICK_ROUNDS if context.scope.quick else kernel.ROUNDS)
    try:
        result["rtl"] = asdict(clocks.measure(Build(), kernel.SPEC))
    except ConfigError as error:
        context.say(f"no row of the RTL: {error}")
    return result


def _times_ms(document: Document) -> dict[str, tuple[float, str]]:
    """Time and 99th percentile of each implementation, the slowest first."""
    ours = {
        name: (times["p50_us"] / 1e3, f"{times['p99_us'] / 1e3:.4f}")
        for name, times in document["result"]["candidates"].items()
    }
    others = {name: (time_ms, "") for name, time_ms in PAPER_MS.items()}
    if (rtl := document["result"].get("rtl")) is not None:
        others[RTL] = (rtl["frame"] / NOMINAL_MHZ / 1e3, "")
    return dict(sorted((others | ours).items(), key=lambda item: -item[1][0]))


def draw(document: Document) -> Figure:
    """A point for each implementation; the scale is logarithmic, on which bars would have no length."""
    times = _times_ms(document)
    figure, ((axes,),) = new_figure(1, 1, 7.4, 1.6 + 0.32 * len(times))
    for row, (name, (time_ms, _)) in enumerate(times.items()):
        mark, shade, what = _MARKS.get(name, ("o", 0, "this machine's CPU"))
        axes.plot(time_ms, row, mark, color=colour(shade), label=what)
        axes.text(time_ms * 1.3, row, f"{_readable(time_ms)} ms", va="center", fontsize=8)
    axes.set_yticks(range(len(times)), list(times))
    axes.set(xscale="log", xlabel="ms per inference")
    slowest, fastest = (pick(time_ms for time_ms, _ in times.values()) for pick in (max, min))
    axes.set_xlim(fastest / 2, slowest * 8)
    how = (
        f"{document['result']['network']}; p50, one thread, in a loop with everything in its caches; "
        f"{document['machine']['cpu']}"
    )
    entitle(figure, document["title"], of=caption(document, how), legend=[axes])
    return figure


_MARKS = {RTL: ("s", 2, _CIRCUIT)} | dict.fromkeys(PAPER_MS, ("D", 1, _PAPER))


def _readable(time_ms: float) -> str:
    return f"{time_ms:.3g}" if time_ms < 100 else f"{time_ms:,.0f}"


def table(document: Document) -> str:
    """Every implementation, the fastest last."""
    binarized = document["result"]["candidates"]
    fastest_ms = min(times["p50_us"] for times in binarized.values()) / 1e3
    rows = [
        [
            name,
            _readable(time_ms),
            p99_ms,
            "" if name in _MARKS else f"{time_ms / fastest_ms:,.1f}",
        ]
        for name, (time_ms, p99_ms) in _times_ms(document).items()
    ]
    heading = ["implementation", "p50 (ms)", "p99 (ms)", "x our fastest"]
    note = _NOTE + (_RTL_NOTE if "rtl" in document["result"] else "")
    return f"{markdown_table(heading, rows)}\n\n{note}"


INFERENCE = Target(
    name="inference",
    title="Network inference time (the paper's Table III)",
    algorithms=(),
    plan=plan,
    measure=measure,
    draw=draw,
    table=table,
)
