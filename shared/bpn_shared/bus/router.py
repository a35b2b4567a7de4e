"""`bpn-router`: a Zenoh router in Python, a drop-in for the official one on a single machine."""

import argparse
import json
import logging
from pathlib import Path

import zenoh

from bpn_shared.bus.session import DEFAULT_ENDPOINT
from bpn_shared.service import end_with_supervisor, set_up_logging, stop_on_signals

log = logging.getLogger("bpn_router")

CONFIG_FILE = Path(__file__).with_name("router.json5")


def open_router(endpoint: str, config_file: Path = CONFIG_FILE) -> zenoh.Session:
    """Opens a router that listens at `endpoint`.

    Raises:
        zenoh.ZError: the port is taken or the configuration is wrong.
    """
    config = zenoh.Config.from_file(str(config_file))
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    return zenoh.open(config)


def main(argv: list[str] | None = None) -> int:
    """Runs the router until SIGINT or SIGTERM."""
    parser = argparse.ArgumentParser(prog="bpn-router", description=__doc__)
    parser.add_argument("--listen", default=DEFAULT_ENDPOINT, help="endpoint (default %(default)s)")
    parser.add_argument("--config", type=Path, default=CONFIG_FILE, help="Zenoh JSON5 file")
    options = parser.parse_args(argv)
    set_up_logging("router")
    stop = stop_on_signals()
    end_with_supervisor()
    try:
        with open_router(options.listen, options.config):
            log.info("router listens at %s", options.listen)
            stop.wait()
    except zenoh.ZError as error:
        log.error("router cannot listen at %s: %s", options.listen, error)
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
