"""A machine's certificate is good for its own site, and for nothing of another one: real routers, mutual TLS."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from uuid import UUID

import pytest
import zenoh
from secure_router import SecureRouter

from bpn_certificates import authority as x509
from bpn_certificates.authority import Validity
from bpn_shared.bus import keys
from bpn_shared.bus.admitted import ADMITTED
from bpn_shared.bus.identity import Identity
from bpn_shared.bus.requests import PatternResponder, Responder
from bpn_shared.bus.session import Bus
from bpn_shared.counters import Counters

WaitFor = Callable[..., None]
OpenAs = Callable[[str], Bus]
RUN = UUID(int=7)
HERE, THERE = "lab-b", "lab-c"
ROBOT = Identity.of("robot_sim", HERE, "pi-7")
MACHINE = Identity.of("router", HERE, "pi-8")
OBSERVER = "observer"


@pytest.fixture(scope="module", autouse=True)
def machines(router: SecureRouter) -> SecureRouter:
    """The router admits a robot of its own certificate, and a machine with a router."""
    for identity in (ROBOT, MACHINE):
        certificate = x509.issue(router.authority, identity.common_name, Validity.of_days(1))
        router.issue(identity.machine, certificate)
    admitted = router.certificates / "router" / ADMITTED
    admitted.write_text(json.dumps([ROBOT.common_name, MACHINE.common_name]))
    return router


@pytest.fixture(scope="module")
def machine_bus(machines: SecureRouter, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bus]:
    """A service on the machine, as its router's client."""
    endpoint = f"unixsock-stream/{tmp_path_factory.mktemp('machine')}/router.sock"
    process = subprocess.Popen(
        [
            sys.executable, "-m", "bpn_shared.bus.router", "--listen", endpoint, "--upstream", machines.endpoint,
            "--certificates", str(machines.certificates / MACHINE.machine),
        ]
    )  # fmt: skip
    try:
        with Bus(endpoint) as bus:
            yield bus
    finally:
        process.terminate()
        process.wait(10)


def keys_of(site: str, worker: str) -> list[str]:
    """What workers of a site may say or hold, as a robot or an edge."""
    return [
        keys.frame(RUN, 0, site),
        keys.preview(RUN, 0, site),
        keys.telemetry("robot_sim", worker),
    ]


def published(sender: Bus, observer: Bus, wait_for: WaitFor, marker: str) -> set[str]:
    """What gets through of what a robot of either site, or a learner, would publish."""
    seen: set[str] = set()
    subscriber = observer.zenoh.declare_subscriber(
        "bpn/**",
        zenoh.handlers.Callback(lambda sample: seen.add(str(sample.key_expr)), indirect=False),
    )
    wait_for(lambda: sender.zenoh.put(marker, b"") or marker in seen, "the first message", 30)
    seen.clear()
    tried = [*keys_of(HERE, f"{HERE}.robot-sim-p4-x"), *keys_of(THERE, f"{THERE}.robot-sim-p4-x")]
    tried += [*keys_of("main", "robot-sim-p4-x"), keys.weights(RUN), "bpn/else"]
    for key in tried:
        sender.zenoh.put(key, b"1", congestion_control=zenoh.CongestionControl.BLOCK)
    end = f"{marker}-end"
    sender.zenoh.put(end, b"", congestion_control=zenoh.CongestionControl.BLOCK)
    wait_for(lambda: end in seen, "the last message")
    del subscriber
    return seen - {end, marker}


def test_a_robots_certificate_is_good_for_its_own_site_alone(
    open_as: OpenAs, wait_for: WaitFor
) -> None:
    robot, observer = open_as(ROBOT.machine), open_as(OBSERVER)
    marker = keys.telemetry("robot_sim", f"{HERE}.m")
    assert published(robot, observer, wait_for, marker) == set(
        keys_of(HERE, f"{HERE}.robot-sim-p4-x")
    )


def test_a_machines_router_passes_on_what_its_site_may_say_and_nothing_else(
    machine_bus: Bus, open_as: OpenAs, wait_for: WaitFor
) -> None:
    marker = keys.telemetry("robot_sim", f"{HERE}.m")
    assert published(machine_bus, open_as(OBSERVER), wait_for, marker) == set(
        keys_of(HERE, f"{HERE}.robot-sim-p4-x")
    )


def test_behind_a_machines_router_everything_works_that_its_workers_need(
    machine_bus: Bus, open_as: OpenAs, wait_for: WaitFor
) -> None:
    learner, dashboard = open_as("learner"), open_as("dashboard")
    worker = f"{HERE}.edge-p4-x"
    got: list[str] = []

    def direct(sample: zenoh.Sample) -> None:
        got.append(str(sample.key_expr))

    keep = [
        machine_bus.zenoh.declare_subscriber(
            keys.weights(RUN), zenoh.handlers.Callback(direct, indirect=False)
        ),
        dashboard.zenoh.liveliness().declare_subscriber(
            keys.live("*", "*"), zenoh.handlers.Callback(direct, indirect=False), history=True
        ),
        machine_bus.zenoh.liveliness().declare_token(keys.live("edge", worker)),
    ]
    responders = [
        Responder(bus, key, lambda body: b"yes" + body, Counters())
        for bus, key in (
            (learner, keys.next_episode(RUN)),
            (learner, keys.config(RUN)),
            (machine_bus, keys.control("edge", worker)),
        )
    ]
    responders.append(
        PatternResponder(dashboard, keys.LEASE_REQUESTS, lambda _key, body: body, Counters())
    )

    def answers(bus: Bus, key: str) -> bool:
        return any(reply.ok is not None for reply in bus.zenoh.get(key, payload=b"1", timeout=1.0))

    for bus, key in (
        (machine_bus, keys.next_episode(RUN)),
        (machine_bus, keys.config(RUN)),
        (machine_bus, keys.lease_request(HERE)),
        (dashboard, keys.control("edge", worker)),
    ):
        wait_for(lambda bus=bus, key=key: answers(bus, key), f"an answer at {key}", 30)
    assert answers(learner, keys.lease_request("main"))
    assert not answers(machine_bus, keys.lease_request("main"))
    learner.zenoh.put(keys.weights(RUN), b"1")
    wait_for(lambda: keys.weights(RUN) in got, "weights behind the machine's router")
    wait_for(lambda: keys.live("edge", worker) in got, "the token of the machine's edge")
    for responder in responders:
        responder.close()
    del keep


def test_who_is_taken_off_the_list_can_do_nothing_more(
    machines: SecureRouter, open_as: OpenAs, wait_for: WaitFor
) -> None:
    robot, observer, seen = open_as(ROBOT.machine), open_as(OBSERVER), []
    key = keys.frame(RUN, 0, HERE)
    subscriber = observer.zenoh.declare_subscriber(
        key, zenoh.handlers.Callback(lambda _: seen.append(1), indirect=False)
    )
    wait_for(lambda: robot.zenoh.put(key, b"") or seen, "a frame")
    admitted = machines.certificates / "router" / ADMITTED
    admitted.write_text(json.dumps([MACHINE.common_name]))

    def unheard() -> bool:
        seen.clear()
        robot.zenoh.put(key, b"", congestion_control=zenoh.CongestionControl.BLOCK)
        alive = keys.health("robot_sim", "none")
        list(observer.zenoh.get(alive, timeout=0.3))
        return robot.connected and observer.connected and not seen

    wait_for(unheard, "silence", 20)
    del subscriber
