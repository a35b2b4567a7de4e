"""Records the episode that is being played."""

import numpy as np
import numpy.typing as npt

from bpn_shared.bnn.outputs import Outputs
from bpn_shared.messages.control import Assignment
from bpn_shared.messages.episode import Episode, EpisodeMeta
from bpn_shared.messages.frame import FrameHeader, FrameKind
from bpn_shared.spec.joint_actions import all_parted
from bpn_shared.spec.observation import stack
from bpn_shared.spec.tasks import TaskSpec


class EpisodeRecorder:
    """Frames, actions as applied, and network outputs of one episode, in step order."""

    def __init__(self, task: TaskSpec) -> None:
        self._task = task
        self._headers: list[FrameHeader] = []
        self._frames: list[npt.NDArray[np.uint8]] = []
        self._outputs: list[Outputs] = []
        self._inference_ns: list[int] = []
        self._received_ns: list[int] = []
        self._edge_ns: list[int] = []

    @property
    def next_step(self) -> int:
        """The step of the frame that has to come next."""
        return len(self._frames)

    def holds(self, header: FrameHeader) -> bool:
        """Whether that very frame was added, not just another one of its step."""
        step = header.step
        return step < len(self._headers) and self._headers[step].t_capture_ns == header.t_capture_ns

    def add_frame(
        self, header: FrameHeader, pixels: npt.NDArray[np.uint8], t_receive_ns: int
    ) -> None:
        """Appends the frame of step `next_step`."""
        self._received_ns.append(t_receive_ns)
        self._headers.append(header)
        self._frames.append(pixels)

    def observation(self) -> npt.NDArray[np.uint8]:
        """s_t after the newest frame, uint8[C, rows, columns]."""
        task = self._task
        newest = len(self._frames) - 1
        return stack(self._frames, newest, task.frames_stacked, difference=task.gym.difference)

    def add_outputs(self, outputs: Outputs, inference_ns: int, edge_ns: int) -> None:
        """Appends what the network said to the newest observation, and how long it and the edge took."""
        self._outputs.append(outputs)
        self._inference_ns.append(inference_ns)
        self._edge_ns.append(edge_ns)

    def latencies_us(self) -> dict[str, npt.NDArray[np.float64]]:
        """How long the hops of the episode's steps took, microseconds, by the names of docs/metrics.md.

        The two hops between robot and edge compare two clocks: they are right where both are one machine's.
        """
        captured_ns = np.array([header.t_capture_ns for header in self._headers[:-1]], np.float64)
        received_ns = np.array(self._received_ns[:-1], np.float64)
        edge_ns = np.array(self._edge_ns, np.float64)
        loop_ns = np.array([header.camera_to_action_ns for header in self._headers[1:]], np.float64)
        in_time = loop_ns > 0
        camera_to_edge_ns = received_ns - captured_ns
        bus_ns = (loop_ns - edge_ns)[in_time]
        hops_ns = {
            "camera_to_edge": camera_to_edge_ns,
            "inference": np.array(self._inference_ns, np.float64),
            "edge": edge_ns,
            "action_to_robot": bus_ns - camera_to_edge_ns[in_time],
            "bus": bus_ns,
            "camera_to_action": loop_ns[in_time],
        }
        return {f"{name}_us": durations_ns / 1e3 for name, durations_ns in hops_ns.items()}

    def finish(
        self, assignment: Assignment, *, slot: int, worker: str, weights_attempt: int
    ) -> Episode:
        """The episode, once the last frame was added. Actions are those that the robot applied."""
        later, last = self._headers[1:], self._headers[-1]
        dims = self._task.dims
        actions = all_parted(np.array([header.applied_action for header in later], np.int64), dims)
        return Episode(
            meta=EpisodeMeta(
                iteration=assignment.iteration,
                episode=assignment.episode,
                seed=assignment.seed,
                slot=slot,
                worker=worker,
                weights_attempt=weights_attempt,
                weights_version=assignment.weights_version,
                terminated=last.kind == FrameKind.TERMINATED,
                success=last.success,
                deadline_misses=last.deadline_misses,
                duration_ns=self._received_ns[-1] - self._received_ns[0],
            ),
            frames=np.stack(self._frames),
            actions=(actions if len(dims) > 1 else actions[:, 0]).astype(np.uint8),
            rewards=np.array([header.reward for header in later], np.float64),
            outputs=np.stack(self._outputs),
            inference_ns=np.array(self._inference_ns, np.uint32),
            camera_to_action_ns=np.array(
                [header.camera_to_action_ns for header in later], np.uint32
            ),
        )
