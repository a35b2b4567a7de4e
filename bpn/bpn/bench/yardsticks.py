"""What the loop's latency is measured by: bare round trips of the same bytes.

A plain Unix socket (what the machine gives), two Zenoh streams over a Unix socket without a router, the same
through the router, that with the robot's simulation and rendering before each ping (a core that has worked on
something else, or slept, answers more slowly), and Zenoh's request and reply through the router.
"""

import contextlib
import itertools
import os
import time
from collections.abc import Iterator

from bpn.bench.sockets import socket_round_trips_us
from bpn_robot_sim.robots import make_robot
from bpn_shared.bus.echo import request_times_us, round_trips_us
from bpn_shared.bus.session import Bus

NAMES = ("socket_us", "direct_echo_us", "echo_us", "echo_after_render_us", "request_us")
_WARM_UP = 50


@contextlib.contextmanager
def on_core(core: int | None) -> Iterator[None]:
    """Has this process, and the threads that it starts, the core that the robot and its edge have."""
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, cores if core is None else {core})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)


def measure(
    endpoint: str,
    direct: str,
    task: str,
    message_bytes: tuple[int, int],
    *,
    count: int,
    period_s: float,
) -> dict[str, list[float]]:
    """Times each of them, microseconds.

    Args:
        endpoint: of a router at which an echo is.
        direct: where another echo listens.
        task: whose robot renders.
        message_bytes: of what goes there, and what comes back.
        count: round trips of each.
        period_s: from one to the next; 0: one after the other.
    """
    robot = make_robot(task)
    robot.reset(0)
    actions = itertools.cycle(range(robot.task.joint_actions))
    wait = Ticks(period_s).wait

    def render() -> None:
        wait()
        robot.command(next(actions))
        robot.settle()
        robot.frame()

    frame_bytes, action_bytes = message_bytes
    times = {"socket_us": socket_round_trips_us(frame_bytes, action_bytes, count, between=wait)}
    with Bus(direct) as bus:
        round_trips_us(bus, frame_bytes, _WARM_UP)
        times["direct_echo_us"] = round_trips_us(bus, frame_bytes, count, between=wait)
    with Bus(endpoint) as bus:
        round_trips_us(bus, frame_bytes, _WARM_UP)
        times["echo_us"] = round_trips_us(bus, frame_bytes, count, between=wait)
        times["echo_after_render_us"] = round_trips_us(bus, frame_bytes, count, between=render)
        times["request_us"] = request_times_us(bus, frame_bytes, count, between=wait)
    robot.close()
    return times


class Ticks:
    """Equal periods, as the robot's driver has them."""

    def __init__(self, period_s: float) -> None:
        self._period_s, self._next_s = period_s, 0.0

    def wait(self) -> None:
        """Sleeps until the next period begins."""
        now_s = time.monotonic()
        self._next_s = max(self._next_s + self._period_s, now_s)
        time.sleep(self._next_s - now_s)
