"""`bpn bench`: side-by-side measurements on this machine."""

import argparse
import importlib


def add(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    parser = subparsers.add_parser(
        "bench", help="measure kernel, learner or loop", description=__doc__
    )
    parser.add_argument("what", choices=("kernel", "learner", "loop"))
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Runs one benchmark; its dependencies are loaded only then."""
    module = importlib.import_module(f"bpn.bench.{options.what}")
    status: int = module.main(as_json=options.json)
    return status
