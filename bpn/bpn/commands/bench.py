"""`bpn bench`: side-by-side measurements on this machine."""

import argparse
import importlib
import json
from collections.abc import Sequence
from typing import Any

from bpn_shared.errors import InputError


def add_options(parser: argparse.ArgumentParser, _arguments: Sequence[str]) -> None:
    parser.add_argument("what", choices=("kernel", "learner", "learners", "loop", "dashboard"))
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument(
        "--parts",
        metavar="A,B",
        help="of dashboard, some of series, lists, ingest, cameras, deaf, browser (default all)",
    )
    parser.add_argument(
        "--quick", action="store_true", help="of dashboard: small, to see that everything works"
    )
    parser.add_argument(
        "--pace",
        metavar="PACE",
        help="of loop: hot (default), frame after frame, or own, a frame in each of the robot's control periods",
    )
    parser.add_argument(
        "--conv",
        metavar="LIST",
        help="of kernel: other convolutions, KERNELxSTRIDExCHANNELS of each, such as 8x4x32,4x2x64,3x1x64",
    )
    parser.add_argument(
        "--image-px", metavar="PX", type=int, help="of kernel: images of another size, 8 to 128"
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Runs one benchmark; its dependencies are loaded only then. Exit status 1 if it misses a target."""
    given: dict[str, Any] = {"quick": True} if options.quick else {}
    if options.parts is not None:
        given["parts"] = options.parts.split(",")
    if given and options.what != "dashboard":
        raise InputError(f"--parts and --quick are of `bpn bench dashboard`, not {options.what}")
    if options.pace is not None:
        if options.what != "loop":
            raise InputError(f"--pace is of `bpn bench loop`, not {options.what}")
        given["pace"] = options.pace
    for name in ("conv", "image_px"):
        if getattr(options, name) is not None:
            if options.what != "kernel":
                option = f"--{name.replace('_', '-')}"
                raise InputError(f"{option} is of `bpn bench kernel`, not {options.what}")
            given[name] = getattr(options, name)
    benchmark = importlib.import_module(f"bpn.bench.{options.what}")
    result = benchmark.run(**given)
    if options.json:
        print(json.dumps(result))
    else:
        benchmark.show(result)
    return 0 if benchmark.met(result) else 1
