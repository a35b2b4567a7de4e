"""The router's configuration: bare for one machine; with certificates, access control and caps for networks.

`python -m bpn_shared.bus.router_config` prints the second, which deploy/router/router.json5 holds for
`bpn-router --config` and for the official router image alike.
"""

import itertools
import json
from collections.abc import Iterable, Sequence
from pathlib import PurePosixPath
from typing import Any, get_args

from bpn_shared.bus.access import (
    CHANNELS,
    ENVELOPE_BYTES,
    EVERYTHING,
    ROLES,
    ROUTER,
    Flow,
    Grant,
    MessageType,
    grants,
)
from bpn_shared.bus.certificates import AUTHORITY, CERTIFICATE, KEY
from bpn_shared.bus.identity import Identity
from bpn_shared.messages.episode import MAX_BYTES

MAX_SESSIONS = 1024
MAX_SESSIONS_PENDING = 128
SECURE_ENDPOINT = "tls/0.0.0.0:7447"
CERTIFICATES = PurePosixPath("/certificates")
"""Where containers find the certificates of their role."""

_LINE_WIDTH = 100

Config = dict[str, Any]


def bare() -> Config:
    """A router without authentication: for loopback and Unix sockets."""
    return {
        "mode": "router",
        "scouting": {"multicast": {"enabled": False}},
        # Ours are in the messages, on the clocks that they are compared with.
        "timestamping": {"enabled": False},
        "transport": {
            # Off: with it, a receiver frozen for 0.3 s read wrong bytes without an error.
            "shared_memory": {"enabled": False},
            "unicast": {"max_sessions": MAX_SESSIONS, "accept_pending": MAX_SESSIONS_PENDING},
            "link": {
                "tx": {
                    "lease": 3000,  # ms; a frozen peer is gone after this
                    # us; a frozen subscriber of weights stalls the learner for at most this long
                    "queue": {"congestion_control": {"block": {"wait_before_close": 500_000}}},
                },
                "rx": {"max_message_size": MAX_BYTES + 1024 * 1024},
            },
        },
    }


def secure(endpoint: str = SECURE_ENDPOINT, certificates: PurePosixPath = CERTIFICATES) -> Config:
    """A router that admits only who has a certificate of our authority, to what its role may do.

    Another router may pass on everything: it has checked its own side's services by the same rules.
    """
    config = bare()
    config["listen"] = {"endpoints": [endpoint]}
    config["transport"]["link"]["tls"] = {
        "root_ca_certificate": str(certificates / AUTHORITY),
        "listen_certificate": str(certificates / CERTIFICATE),
        "listen_private_key": str(certificates / KEY),
        "connect_certificate": str(certificates / CERTIFICATE),  # to another site's router
        "connect_private_key": str(certificates / KEY),
        "enable_mtls": True,
        "close_link_on_expiration": True,
    }
    config["access_control"] = access_control()
    config["low_pass_filter"] = size_limits()
    config["adminspace"] = {"enabled": True, "permissions": {"read": True, "write": False}}
    return config


def at_site(upstream: str, certificates: PurePosixPath) -> Config:
    """A router for the services of one machine, which passes on to another router what that one lets it.

    Nobody on the machine is asked who they are, so it may listen for this machine alone.
    """
    config = bare()
    config["connect"] = {
        "endpoints": [upstream],
        "timeout_ms": -1,
        "exit_on_failure": False,
        "retry": {"period_init_ms": 50, "period_max_ms": 1000, "period_increase_factor": 1.5},
    }
    config["transport"]["link"]["tls"] = {
        "root_ca_certificate": str(certificates / AUTHORITY),
        "connect_certificate": str(certificates / CERTIFICATE),
        "connect_private_key": str(certificates / KEY),
        "enable_mtls": True,
        "verify_name_on_connect": True,
        "close_link_on_expiration": True,
    }
    return config


def access_control() -> Config:
    """Zenoh's form of the grants: deny, except one rule for each role, direction and type of message."""
    config: Config = {
        "enabled": True,
        "default_permission": "deny",
        "rules": [],
        "subjects": [],
        "policies": [],
    }
    granted = grants()
    for role in sorted(ROLES):
        _admit(config, role, [grant for grant in granted if grant.role == role])
    everything = {
        "id": f"{ROUTER}-everything",
        "permission": "allow",
        "flows": get_args(Flow),
        "messages": get_args(MessageType),
        "key_exprs": [EVERYTHING],
    }
    _admit(config, ROUTER, [], [everything])
    return config


def admitting(config: Config, machines: Iterable[Identity]) -> Config:
    """An access control that lets these machines do what their sites may, beside what it has."""
    lists = ("rules", "subjects", "policies")
    extended = config | {name: list(config.get(name) or []) for name in lists}
    for machine in machines:
        _admit(extended, machine.common_name, machine.grants())
    return extended


def _admit(
    config: Config, name: str, granted: Iterable[Grant], more: Sequence[Config] = ()
) -> None:
    """Adds who has certificates of this name, and what they may do."""

    def rule(grant: Grant) -> tuple[str, str]:
        return grant.flow, grant.message

    rules = [
        {
            "id": f"{name}-{flow}-{message}",
            "permission": "allow",
            "flows": [flow],
            "messages": [message],
            "key_exprs": sorted({grant.key for grant in group}),
        }
        for (flow, message), group in itertools.groupby(sorted(granted, key=rule), key=rule)
    ]
    rules += more
    config["rules"] += rules
    config["subjects"].append({"id": name, "cert_common_names": [name]})
    config["policies"].append({"subjects": [name], "rules": [r["id"] for r in rules]})


def size_limits() -> list[Config]:
    """Zenoh's filters that drop what is larger than its channel allows, one for each size."""
    by_size: dict[int, set[str]] = {}
    for channel in CHANNELS:
        if channel.givers:  # the others are patterns over channels that have their own limits
            by_size.setdefault(channel.max_bytes, set()).add(channel.key)
    return [
        {
            "id": f"at-most-{size_bytes}",
            "flows": ["ingress"],
            "messages": ["put", "query", "reply"],
            "key_exprs": sorted(patterns),
            "size_limit": size_bytes + ENVELOPE_BYTES,
        }
        for size_bytes, patterns in sorted(by_size.items())
    ]


def render(config: Config) -> str:
    """The configuration as a JSON5 file."""
    head = "// Generated from bpn_shared/bus/access.py: python -m bpn_shared.bus.router_config\n"
    return f"{head}{_lines(config)}\n"


def _lines(value: Any, indent: str = "") -> str:
    """JSON with what fits into a line in one."""
    line = json.dumps(value)
    if len(indent) + len(line) <= _LINE_WIDTH or not isinstance(value, dict | list):
        return line
    inner = indent + "  "
    if isinstance(value, dict):
        parts = [f"{json.dumps(key)}: {_lines(part, inner)}" for key, part in value.items()]
        opening, closing = "{", "}"
    else:
        parts = [_lines(part, inner) for part in value]
        opening, closing = "[", "]"
    return f"{opening}\n{inner}" + f",\n{inner}".join(parts) + f"\n{indent}{closing}"


if __name__ == "__main__":
    print(render(secure()), end="")
