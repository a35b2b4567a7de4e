"""`bpn-router`: a Zenoh router in Python, a drop-in for the official one."""

import argparse
import json
import logging
from ipaddress import ip_address
from pathlib import Path

import zenoh

from bpn_shared.bus.router_config import bare
from bpn_shared.bus.session import DEFAULT_ENDPOINT
from bpn_shared.config import ConfigError
from bpn_shared.heartbeat import Heartbeat
from bpn_shared.service import end_with_supervisor, set_up_logging, stop_on_signals

log = logging.getLogger("bpn_router")


def configure(
    endpoint: str | None = None, config_file: Path | None = None, upstream: str | None = None
) -> zenoh.Config:
    """The configuration of a router that nobody can use who should not.

    Args:
        endpoint: where it listens; None: where the file says, or the default.
        config_file: a Zenoh JSON5 file; None: a router without authentication, for this machine only.
        upstream: another router, with which this one makes one bus.

    Raises:
        ConfigError: others could reach it, and it asks for no certificates.
        zenoh.ZError: the file is none.
    """
    if config_file is None:
        config = zenoh.Config.from_json5(json.dumps(bare()))
        endpoint = endpoint or DEFAULT_ENDPOINT
    else:
        config = zenoh.Config.from_file(str(config_file))
    if endpoint is not None:
        config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    if upstream is not None:
        config.insert_json5("connect/endpoints", json.dumps([upstream]))
    asks_who = json.loads(config.get_json("transport/link/tls"))["enable_mtls"]
    for open_door in filter(lambda e: not is_local(e), endpoints(config)):
        if not (open_door.startswith(("tls/", "quic/")) and asks_who):
            raise ConfigError(
                f"{open_door} can be reached from other machines, and nobody would be asked who they are: "
                "listen on loopback, or on tls/ with a configuration like deploy/router/router.json5"
            )
    return config


def endpoints(config: zenoh.Config) -> list[str]:
    """Where a router of this configuration listens."""
    listen = json.loads(config.get_json("listen/endpoints"))
    if isinstance(listen, dict):  # a list for each mode
        listen = listen.get("router", [])
    return [listen] if isinstance(listen, str) else list(listen)


def is_local(endpoint: str) -> bool:
    """Whether only this machine can reach an endpoint."""
    protocol, _, address = endpoint.partition("/")
    if protocol == "unixsock-stream":
        return True
    host = address.rpartition(":")[0].strip("[]")
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


def main(argv: list[str] | None = None) -> int:
    """Runs the router until SIGINT or SIGTERM."""
    parser = argparse.ArgumentParser(prog="bpn-router", description=__doc__)
    parser.add_argument(
        "--listen", help=f"endpoint (default: as the file says, else {DEFAULT_ENDPOINT})"
    )
    parser.add_argument("--config", type=Path, help="Zenoh JSON5 file (default: for this machine)")
    parser.add_argument("--upstream", metavar="ENDPOINT", help="another site's router to join")
    options = parser.parse_args(argv)
    set_up_logging("router")
    zenoh.init_log_from_env_or("off")
    stop = stop_on_signals()
    end_with_supervisor()
    try:
        config = configure(options.listen, options.config, options.upstream)
        with zenoh.open(config), Heartbeat():
            log.info("router listens at %s", ", ".join(endpoints(config)))
            stop.wait()
    except (ConfigError, zenoh.ZError) as error:
        log.error("router cannot listen at %s: %s", options.listen or "its endpoint", error)
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
