"""Plays one episode: frame in, kernel, policy, action out."""

import secrets
import time
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from bpn_edge.memory import WeightMemory
from bpn_edge.recorder import EpisodeRecorder
from bpn_edge.robot_link import RobotLink
from bpn_shared.messages.action import Action
from bpn_shared.messages.control import Assignment, Reset
from bpn_shared.messages.episode import Episode
from bpn_shared.seeds import action_uniform
from bpn_shared.tasks import Task
from bpn_shared.worker import Worker

Choose = Callable[[npt.NDArray[np.int32], float], int]
"""From o int32[|A|] and a uniform number in [0, 1) to an action."""


class EpisodeDriver:
    """Drives the robot of one slot through episodes.

    Args:
        silence_s: how long no frame may come before the robot is asked again to begin the episode (it may
            have been restarted, or the frame was lost).
    """

    def __init__(
        self, worker: Worker, task: Task, link: RobotLink, memory: WeightMemory, silence_s: float
    ) -> None:
        self._worker, self._task = worker, task
        self._link, self._memory = link, memory
        self._silence_s = silence_s

    def play(self, assignment: Assignment, choose: Choose) -> Episode | None:
        """Plays the assigned episode with the weights in the active bank.

        A robot that was restarted begins again at step 0, and so does the recording; seed and weights are
        the same, hence so is the episode.

        Returns:
            The finished episode; None if the worker was stopped or a frame is missing (realtime pacing
            over a slow link): such an episode is not data and has to be played again.
        """
        reset = Reset(
            iteration=assignment.iteration,
            episode=assignment.episode,
            seed=assignment.seed,
            reset_id=secrets.randbits(64),
        )
        if not self._link.reset(reset):
            return None
        recorder = EpisodeRecorder(self._task)
        answer: Action | None = None
        uniform = action_uniform(assignment.seed, 0)
        last_frame_s = time.monotonic()
        while not self._worker.stop.is_set():
            frame = self._link.next_frame(reset.reset_id, self._silence_s)
            if frame is None:
                if time.monotonic() - last_frame_s >= self._silence_s:
                    self._worker.waiting.set(f"a frame from robot {self._worker.slot}")
                    self._link.reset(reset)
                    last_frame_s = time.monotonic()
                continue
            last_frame_s = time.monotonic()
            self._worker.waiting.done()
            header, pixels, t_receive_ns = frame
            if answer is not None and header.step == answer.step:  # the robot did not hear us
                self._link.send(answer)
                continue
            if header.step == 0 and recorder.next_step > 0:
                self._worker.counters.add("episodes_begun_again")
                recorder = EpisodeRecorder(self._task)
                uniform = action_uniform(assignment.seed, 0)
            if header.step != recorder.next_step:
                self._worker.counters.add("episodes_with_missing_frames")
                return None
            recorder.add_frame(header, pixels, t_receive_ns)
            if header.kind.ends_episode:
                blob = self._memory.blob
                return recorder.finish(
                    assignment,
                    slot=self._worker.slot,
                    worker=self._worker.id,
                    weights_attempt=blob.attempt if blob else 0,
                )
            observation = recorder.observation()
            start_ns = time.perf_counter_ns()
            outputs = self._memory.run(observation)
            inference_ns = time.perf_counter_ns() - start_ns
            answer = Action(
                action=choose(outputs, uniform),
                step=header.step,
                weights_version=assignment.weights_version,
                reset_id=reset.reset_id,
                inference_ns=inference_ns,
                edge_ns=time.monotonic_ns() - t_receive_ns,
            )
            self._link.send(answer)
            recorder.add_outputs(outputs, inference_ns)
            uniform = action_uniform(assignment.seed, header.step + 1)  # off the critical path
        return None
