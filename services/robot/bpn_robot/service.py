"""One robot with its camera. Actions in, frames out.

Lockstep: the robot waits for the action of each frame, repeating the frame while none comes. Realtime:
it ticks at the control period whatever comes; without an action in time the robot is commanded to hold. There an
action may be given a delay, as a slower network or processor would: it then acts that much after it arrived.

A robot that hears no edge for long is stopped, as it is whenever no episode is under way.
"""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from math import isqrt

import numpy as np

from bpn_robot.commands import Commands
from bpn_robot.edge_link import EdgeLink
from bpn_robot.frame import is_flat
from bpn_robot.robot import Robot, RobotFault
from bpn_robot.robots import make_robot
from bpn_shared.bus import keys
from bpn_shared.bus.latest import Sample
from bpn_shared.bus.requests import Responder
from bpn_shared.bus.sampled import SampledPublisher
from bpn_shared.messages.action import Action
from bpn_shared.messages.base import LONGEST_NS, MessageError
from bpn_shared.messages.control import Reset, ResetReply
from bpn_shared.messages.frame import NO_ACTION, NO_REWARD, FrameHeader, FrameKind
from bpn_shared.messages.preview import PreviewHeader
from bpn_shared.runtime.collector import Collector
from bpn_shared.runtime.faults import FaultReporter
from bpn_shared.runtime.worker import EXIT_FINISHED, Worker
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.observation import changes
from bpn_shared.spec.seeds import latency_uniforms

log = logging.getLogger(__name__)

_RESEND_S = 0.25
_PREVIEW_HZ = 30.0


@dataclass(frozen=True, slots=True)
class Answer:
    """The action for a frame, when that was taken and when the action acts (monotonic ns)."""

    action: int
    t_capture_ns: int
    t_act_ns: int

    @property
    def camera_to_action_ns(self) -> int:
        return min(self.t_act_ns - self.t_capture_ns, LONGEST_NS)


class RobotService:
    """Plays episodes as edges begin them. Everything but `_on_reset` runs on the main thread."""

    def __init__(self, worker: Worker, config: RunConfig, robot: Robot) -> None:
        self._worker, self._config, self._robot = worker, config, robot
        self._commands = Commands(robot, worker.counters)
        self._heard_s = 0.0
        """When an edge last said something of this episode."""
        self._task = config.task_spec
        self._delays_ns: list[int] = []
        """Of this episode's actions, from their arrival until they act."""
        self._in_flight: deque[Answer] = deque()
        """Realtime: arrived, and yet to act."""
        self._edge = EdgeLink(worker)
        place = worker.run, worker.slot, worker.site
        self._previews = SampledPublisher(
            worker.bus,
            keys.preview(*place),
            _PREVIEW_HZ,
            _preview,
            worker.counters,
        )
        self._seen: deque[bytes] = deque(maxlen=self._task.frames_stacked)
        self._lock = threading.Lock()
        self._current: Reset | None = None
        self._pending: Reset | None = None
        self._repeat = False
        self._step = 0
        """That is under way in this episode, 1..T; 0: the reset."""
        self._faults = FaultReporter(worker)
        self._collector = Collector()
        self._resets = Responder(worker.bus, keys.reset(*place), self._on_reset, worker.counters)

    def run(self) -> None:
        """Serves until the worker is stopped."""
        with self._collector:
            while not self._worker.stop.is_set():
                reset = self._take_reset()
                if reset is None:
                    self._commands.stop()
                    self._worker.waiting.set("an edge to begin an episode")
                    self._collector.collect()
                    self._edge.take(_RESEND_S)
                    continue
                self._worker.waiting.done()
                self._play(reset)

    def _play(self, reset: Reset) -> None:
        """Plays an episode; one that the robot cannot play is told to the learner, and the robot goes on."""
        try:
            self._drive(reset)
        except RobotFault as fault:
            self._fail(reset, str(fault))
        except Exception as error:
            log.exception("episode (%d, %d) cannot be played", reset.iteration, reset.episode)
            self._fail(reset, f"{type(error).__name__}: {error}")
        finally:
            self._commands.stop()

    def _fail(self, reset: Reset, what: str) -> None:
        at = f" at step {self._step}" if self._step else ""
        self._worker.waiting.set(f"the learner to hear of a fault: {what}")
        self._faults.tell(
            reset.iteration, reset.episode, f"{self._task.name}: {what}{at} (seed {reset.seed})"
        )
        self._forget()

    def _forget(self) -> None:
        """Asked for again, the episode is begun again."""
        with self._lock:
            self._current, self._repeat = None, False

    def close(self) -> None:
        """Stops the robot, and shows nobody any more what its camera sees."""
        self._commands.stop()
        self._previews.close()
        self._edge.close()

    def _on_reset(self, body: bytes) -> bytes:
        reset = Reset.decode(body)
        with self._lock:
            if self._current is not None and reset.reset_id == self._current.reset_id:
                self._repeat = True  # asked again: the frame may have been lost, so send it again
                self._edge.doubt()
            else:
                self._pending = reset
        self._edge.wake()
        return ResetReply(reset_id=reset.reset_id).encode()

    def _take_reset(self) -> Reset | None:
        with self._lock:
            if self._pending is not None:
                self._current, self._pending = self._pending, None
                return self._current
            return None

    def _interrupted(self) -> bool:
        return self._pending is not None or self._repeat or self._worker.stop.is_set()

    def _ends_now(self) -> bool:
        return self._pending is not None or self._worker.stop.is_set()

    def _drive(self, reset: Reset) -> None:
        robot = self._robot
        realtime = self._config.pacing == "realtime"
        self._step = 0
        self._commands.begin()
        frame = robot.reset(reset.seed)
        pixels, blind = frame.tobytes(), is_flat(frame)
        self._in_flight.clear()
        self._delays_ns = self._drawn_delays_ns(reset.seed)
        self._heard_s = time.monotonic()
        self._seen.extend([pixels] * self._task.frames_stacked)
        kind, step, applied, loop_ns, misses = FrameKind.FIRST, 0, NO_ACTION, 0, 0
        reward = NO_REWARD
        while True:
            header = FrameHeader(
                kind, reset.iteration, reset.episode, step, reset.reset_id, time.monotonic_ns(),
                applied, loop_ns, misses, self._task.frame_channels, reward, robot.success,
            )  # fmt: skip
            if kind.ends_episode:
                if blind:
                    self._worker.counters.refuse(
                        "episodes_without_a_picture",
                        f"every frame of episode ({reset.iteration}, {reset.episode}) has one colour only: "
                        "the camera shows nothing",
                    )
                self._commands.stop()
                self._repeat_until_reset(header, pixels)
                return
            self._step = step + 1
            step_robot = self._tick if realtime else self._await_action
            answer = step_robot(header, pixels)
            if self._ends_now():
                return
            if answer is None and self._is_deserted():
                self._desert(reset)
                return
            applied = self._task.hold_action if answer is None else answer.action
            misses += answer is None
            loop_ns = 0 if answer is None else answer.camera_to_action_ns
            frame = robot.frame()
            pixels, blind = frame.tobytes(), blind and is_flat(frame)
            self._seen.append(pixels)
            if self._task.told_rewards:
                reward = robot.reward()
            step += 1
            kind = FrameKind.MID
            if robot.terminated:
                kind = FrameKind.TERMINATED
            elif robot.truncated or step == self._config.steps:
                kind = FrameKind.LAST

    def _await_action(self, header: FrameHeader, pixels: bytes) -> Answer | None:
        """Lockstep: sends the frame until its action comes, applies it and lets the robot settle."""
        while not self._ends_now():
            self._send(header, pixels)
            answer = self._receive(header, time.monotonic() + _RESEND_S, self._interrupted)
            if answer is not None:
                self._worker.waiting.done()
                self._commands.act(answer.action)
                self._robot.settle()
                return answer
            if self._is_deserted():
                self._commands.stop()  # the world waits, and the episode goes on when the edge is back
            if not self._interrupted():
                self._worker.waiting.set("an action from the edge")
                self._worker.counters.add("frames_sent_again")
            self._repeat = False
        return None

    def _tick(self, header: FrameHeader, pixels: bytes) -> Answer | None:
        """Realtime: the world goes on for one control period, in which the next action that is due acts, or hold.

        Without a delay that is the answer to this frame; with one longer than the period, to an older frame.
        """
        period_s = self._task.control_period_s
        start_s, end_ns = header.t_capture_ns / 1e9, header.t_capture_ns + round(period_s * 1e9)
        self._send(header, pixels)
        answer = self._receive(header, end_ns / 1e9, self._ends_now)
        if answer is not None and answer.t_act_ns - self._delays_ns[header.step] < end_ns:
            self._in_flight.append(answer)
        acting = self._due(end_ns)
        if acting is None:
            self._commands.hold()
            self._robot.advance(period_s)
        else:
            before_s = min(max(0.0, acting.t_act_ns / 1e9 - start_s), period_s)
            self._robot.advance(before_s)
            self._commands.act(acting.action)
            self._robot.advance(period_s - before_s)
        self._worker.stop.wait(max(0.0, start_s + period_s - time.monotonic()))
        return acting

    def _is_deserted(self) -> bool:
        """Whether no edge has said anything of this episode for too long."""
        return time.monotonic() - self._heard_s > self._config.longest_silence_s

    def _desert(self, reset: Reset) -> None:
        """Realtime: ends an episode that nobody plays any more; what came of it is no data."""
        self._commands.stop()
        self._forget()
        self._worker.counters.refuse(
            "episodes_deserted",
            f"no action for {self._config.longest_silence_s:g} s in episode ({reset.iteration}, {reset.episode}): "
            "the robot is stopped, and the episode begun again when an edge asks for it",
        )

    def _drawn_delays_ns(self, seed: int) -> list[int]:
        low_ms, high_ms = self._task.disturbances.get("latency", (0.0, 0.0))
        jitter_ms = low_ms + (high_ms - low_ms) * latency_uniforms(seed, self._config.steps)
        return [round((self._config.action_delay_ms + ms) * 1e6) for ms in jitter_ms.tolist()]

    def _due(self, end_ns: int) -> Answer | None:
        """Takes the oldest action in flight if it acts before then; one in a period, as the robot does."""
        if self._in_flight and self._in_flight[0].t_act_ns < end_ns:
            return self._in_flight.popleft()
        return None

    def _repeat_until_reset(self, header: FrameHeader, pixels: bytes) -> None:
        """The episode is over: its last frame is sent until an edge begins another."""
        while not self._ends_now():
            self._send(header, pixels)
            self._repeat = False
            self._collector.collect()  # meanwhile the edge asks for another one
            self._edge.take(_RESEND_S)

    def _receive(
        self, header: FrameHeader, deadline_s: float, interrupted: Callable[[], bool]
    ) -> Answer | None:
        """The action for this frame if it comes before the deadline and nothing interrupts."""
        while not interrupted():
            remaining_s = deadline_s - time.monotonic()
            if remaining_s <= 0:
                self._edge.doubt()
                return None
            sample = self._edge.take(remaining_s)
            if sample is None:
                continue
            answer = self._decode(sample, header)
            if answer is not None:
                return answer
        return None

    def _decode(self, sample: Sample, header: FrameHeader) -> Answer | None:
        try:
            action = Action.decode(sample.payload, self._task.joint_actions)
        except MessageError as error:
            self._worker.counters.refuse("actions_refused", str(error))
            return None
        if action.reset_id == header.reset_id:
            self._heard_s = sample.t_receive_ns / 1e9
        if (action.reset_id, action.step) != (header.reset_id, header.step):
            self._worker.counters.add("actions_for_other_frames")
            return None
        self._edge.answered(sample)
        t_act_ns = sample.t_receive_ns + self._delays_ns[header.step]
        return Answer(action.action, header.t_capture_ns, t_act_ns)

    def _send(self, header: FrameHeader, pixels: bytes) -> None:
        self._edge.send(header.encode(), pixels)
        if self._previews.has_subscribers:
            self._previews.publish_latest((header, self._observed()))

    def _observed(self) -> tuple[bytes, ...]:
        """The frames of the newest observation, as the network sees them."""
        seen = tuple(self._seen)
        if not self._task.gym.difference:
            return seen
        *earlier, newest = (np.frombuffer(pixels, np.uint8) for pixels in seen)
        return *(changes(frame, newest).tobytes() for frame in earlier), seen[-1]


def _preview(item: tuple[FrameHeader, tuple[bytes, ...]]) -> tuple[bytes, bytes]:
    header, frames = item
    preview = PreviewHeader(
        channels=header.channels * len(frames),
        frames_stacked=len(frames),
        iteration=header.iteration,
        episode=header.episode,
        step=header.step,
        t_capture_unix_ns=time.time_ns() - (time.monotonic_ns() - header.t_capture_ns),
        frame_px=isqrt(len(frames[0]) // header.channels),
    )
    return b"".join(frames), preview.encode()


def serve(worker: Worker, config: RunConfig) -> int:
    """Makes the robot of the run's task, and plays it until the worker is stopped.

    Raises:
        PluginError: the robot is not installed here.
    """
    robot = make_robot(config.task_spec)
    service = RobotService(worker, config, robot)
    try:
        service.run()
    finally:
        service.close()
        robot.close()
    return EXIT_FINISHED
