"""Plays one episode: frame in, kernel, policy, action out."""

import logging
import secrets
import threading
import time
from collections.abc import Callable
from math import isfinite

import numpy as np
import numpy.typing as npt

from bpn_edge.decisions import DecisionFeed
from bpn_edge.factored import JointSelector
from bpn_edge.memory import WeightMemory
from bpn_edge.recorder import EpisodeRecorder
from bpn_edge.robot_link import RobotLink
from bpn_shared.bnn.envelope import BlobError
from bpn_shared.messages.action import Action
from bpn_shared.messages.base import LONGEST_NS
from bpn_shared.messages.control import Assignment, Reset
from bpn_shared.messages.episode import Episode
from bpn_shared.messages.frame import FrameHeader, FrameKind
from bpn_shared.runtime.watchdog import STEPS_PLAYED
from bpn_shared.runtime.worker import Worker
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.seeds import choice_uniforms

log = logging.getLogger(__name__)

_LOOK_AROUND_S = 0.2


class EpisodeFault(RuntimeError):  # noqa: N818 - what the bus calls it too
    """The episode cannot be had, and why; equal faults have equal messages."""


class EpisodeDriver:
    """Drives the robot of one slot through episodes.

    Args:
        config: the run's: its task, T, and how time passes.
        silence_s: how long no frame may come before the robot is asked again to begin the episode (it may
            have been restarted, or the frame was lost).
    """

    def __init__(
        self,
        worker: Worker,
        config: RunConfig,
        link: RobotLink,
        memory: WeightMemory,
        feed: DecisionFeed,
        *,
        silence_s: float,
    ) -> None:
        self._worker, self._config = worker, config
        self._link, self._memory, self._feed = link, memory, feed
        self._silence_s = silence_s

    def play(
        self,
        assignment: Assignment,
        choose: JointSelector,
        *,
        meanwhile: Callable[[], None] = lambda: None,
    ) -> Episode | None:
        """Plays the assigned episode with the weights in the active bank.

        Args:
            meanwhile: is called once the robot has begun, or does not, on this thread; frames are answered on the
                network's.

        Returns:
            The finished episode; None if the worker was stopped or a frame is missing (realtime pacing
            over a slow link): such an episode is not data and has to be played again.

        Raises:
            EpisodeFault: it cannot be had: the robot sends what no robot of this task would, or the policy
                gives no action.
        """
        worker = self._worker
        reset = Reset(
            iteration=assignment.iteration,
            episode=assignment.episode,
            seed=assignment.seed,
            reset_id=secrets.randbits(64),
        )
        game = _EpisodeSession(
            worker,
            self._config,
            self._link,
            self._memory,
            self._feed,
            assignment=assignment,
            reset_id=reset.reset_id,
            choose=choose,
        )
        self._link.listen(game.on_frame)
        try:
            self._link.reset(reset, meanwhile=meanwhile)
            meanwhile()
            while not game.over.wait(_LOOK_AROUND_S):
                if worker.stop.is_set():
                    return None
                if game.silent_s() > self._silence_s:
                    worker.waiting.set(f"a frame from robot {worker.slot}")
                    self._link.reset(reset)
                    game.heard(time.monotonic_ns())
        finally:
            self._link.listen(None)
        worker.waiting.done()
        if game.fault is not None:
            raise EpisodeFault(game.fault)
        return game.episode


class _EpisodeSession:
    """One episode while it is played. `on_frame` runs on threads that receive, all else waits for `over`.

    A robot that was restarted begins again at step 0, and so does the recording: seed and weights are the
    same, hence so is the episode.
    """

    def __init__(
        self,
        worker: Worker,
        config: RunConfig,
        link: RobotLink,
        memory: WeightMemory,
        feed: DecisionFeed,
        *,
        assignment: Assignment,
        reset_id: int,
        choose: JointSelector,
    ) -> None:
        self._worker, self._task, self._link, self._memory = worker, config.task_spec, link, memory
        self._feed, self._lockstep = feed, config.pacing == "lockstep"
        self._assignment, self._reset_id, self._choose = assignment, reset_id, choose
        # all at once: between two frames every instruction delays the sending of the last action
        dims = len(self._task.dims)
        self._uniforms: list[list[float]] = choice_uniforms(
            assignment.seed, config.steps, dims
        ).tolist()
        self.over = threading.Event()
        self.episode: Episode | None = None
        self.fault: str | None = None
        self._begin()
        self.heard(time.monotonic_ns())

    def _begin(self) -> None:
        self._recorder = EpisodeRecorder(self._task)
        self._answer: Action | None = None

    def heard(self, t_ns: int) -> None:
        """Notes that the robot gave a sign of life, or a new chance to give one."""
        self._heard_ns = t_ns

    def silent_s(self) -> float:
        """Seconds without a sign of life."""
        return (time.monotonic_ns() - self._heard_ns) / 1e9

    def on_frame(
        self, header: FrameHeader, pixels: npt.NDArray[np.uint8], t_receive_ns: int
    ) -> None:
        """Answers a frame and records it."""
        if header.reset_id != self._reset_id or self.over.is_set():
            self._worker.counters.add("frames_of_other_episodes")
            return
        self.heard(t_receive_ns)
        try:
            self._take(header, pixels, t_receive_ns)
        except BlobError as error:  # outputs that are no numbers
            self._fail(f"the policy at step {header.step}: {error}")
        except Exception as error:
            log.exception("frame %d cannot be answered", header.step)
            self._fail(f"frame {header.step} cannot be answered: {type(error).__name__}: {error}")

    def _fail(self, fault: str) -> None:
        self.fault = fault
        self.over.set()

    def _why_impossible(self, header: FrameHeader) -> str | None:
        """What keeps a frame from being the next one of this episode, whatever the robot may do."""
        applied, first, answer = header.applied_action, header.step == 0, self._answer
        assigned = self._assignment
        sentence = None
        if header.iteration != assigned.iteration or header.episode != assigned.episode:
            sentence = f"is of episode ({header.iteration}, {header.episode})"
        elif first != (header.kind == FrameKind.FIRST):
            sentence = f"is {header.kind.name}"
        elif first:
            pass
        elif applied >= self._task.joint_actions:
            sentence = f"tells of action {applied}, the task has 0..{self._task.joint_actions - 1}"
        elif self._lockstep and answer is not None and applied != answer.action:
            sentence = f"tells of action {applied}, it was given {answer.action}"
        elif self._task.told_rewards and not isfinite(header.reward):
            sentence = f"tells of a reward of {header.reward}"
        return sentence

    def _take(self, header: FrameHeader, pixels: npt.NDArray[np.uint8], t_receive_ns: int) -> None:
        ends = header.kind.ends_episode
        if self._answer is not None and header.step == self._answer.step and not ends:
            self._link.send(self._answer)  # the robot did not hear us
            return
        if self._recorder.holds(header):  # it went two ways, and the other was faster
            self._worker.counters.add("frames_that_came_twice")
            return
        if header.kind == FrameKind.FIRST and self._recorder.next_step > 0:
            self._worker.counters.add("episodes_begun_again")
            self._begin()
        impossible = self._why_impossible(header)
        if impossible is not None:
            self._refuse(f"frame {header.step} of the robot {impossible}")
            return
        beyond = header.step >= len(self._uniforms) and not ends
        if header.step != self._recorder.next_step or beyond:
            if self._lockstep:  # where the robot waits for us, none can be lost
                due = self._recorder.next_step
                self._refuse(f"the robot sends frame {header.step} where frame {due} is due")
                return
            self._worker.counters.add("episodes_with_missing_frames")
            self.over.set()
            return
        self._recorder.add_frame(header, pixels, t_receive_ns)
        if ends:
            self._finish()
        else:
            self._act(header.step, t_receive_ns)

    def _refuse(self, reason: str) -> None:
        self._worker.counters.refuse("frames_refused", reason)
        self._fail(reason)

    def _act(self, step: int, t_receive_ns: int) -> None:
        observation = self._recorder.observation()
        start_ns = time.perf_counter_ns()
        outputs = self._memory.run(observation)
        inference_ns = min(time.perf_counter_ns() - start_ns, LONGEST_NS)
        self._answer = Action(
            action=self._choose(outputs, self._uniforms[step]),
            step=step,
            weights_version=self._assignment.weights_version,
            reset_id=self._reset_id,
            inference_ns=inference_ns,
            edge_ns=min(time.monotonic_ns() - t_receive_ns, LONGEST_NS),
        )
        self._link.send(self._answer)
        self._recorder.add_outputs(outputs, inference_ns, self._answer.edge_ns)
        self._feed.note(self._assignment, self._answer, outputs)
        self._worker.counters.add(STEPS_PLAYED)

    def _finish(self) -> None:
        for name, durations_us in self._recorder.latencies_us().items():
            self._worker.latencies.add(name, durations_us)
        weights = self._memory.weights
        self.episode = self._recorder.finish(
            self._assignment,
            slot=self._worker.slot,
            worker=self._worker.id,
            weights_attempt=weights.attempt if weights else 0,
        )
        self.over.set()
