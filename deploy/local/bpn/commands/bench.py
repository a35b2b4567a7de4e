"""`bpn bench`: side-by-side measurements on this machine."""

import argparse
import importlib
import json


def add(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    parser = subparsers.add_parser(
        "bench", help="measure kernel, learner, learners, loop or dashboard", description=__doc__
    )
    parser.add_argument("what", choices=("kernel", "learner", "learners", "loop", "dashboard"))
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Runs one benchmark; its dependencies are loaded only then. Exit status 1 if it misses a target."""
    benchmark = importlib.import_module(f"bpn.bench.{options.what}")
    result = benchmark.run()
    if options.json:
        print(json.dumps(result))
    else:
        benchmark.show(result)
    return 0 if benchmark.met(result) else 1
