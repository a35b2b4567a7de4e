"""The learner's side of the loop, spoken by a test: it assigns, takes what is delivered and hears of faults."""

import threading
from collections.abc import Callable
from dataclasses import replace
from uuid import UUID

import numpy as np

from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bus import keys
from bpn_shared.bus.requests import Responder
from bpn_shared.bus.session import Bus
from bpn_shared.bus.weights import WeightsPublisher
from bpn_shared.counters import Counters
from bpn_shared.messages.control import (
    Assignment,
    EpisodeReceipt,
    Fault,
    FaultReceipt,
    NextEpisode,
)
from bpn_shared.messages.episode import Episode
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.seeds import episode_seed

RUN = UUID(int=21)
DEADLINE_S = 60.0


class LearnerSide:
    """Assigns one episode again and again; keeps what is delivered and what faults are told.

    Attributes:
        attempt, version: of the weights that the episode needs.
        hears: whether faults are answered.
        disk: while it is cleared, no episode gets its receipt.
        asked: what was asked for, in order.
    """

    def __init__(self, bus: Bus, config: RunConfig, *, version: int = 7) -> None:
        self._config = config
        self.weights = WeightsPublisher(bus, RUN)
        self.attempt, self.version, self.episode = 1, version, 0
        self.hears = True
        self.disk = threading.Event()
        self.disk.set()
        self.asked: list[NextEpisode] = []
        self.delivered: list[Episode] = []
        self.faults: list[Fault] = []
        self._news = threading.Condition()
        answers: dict[str, Callable[[bytes], bytes]] = {
            keys.config(RUN): lambda _: config.model_dump_json().encode(),
            keys.next_episode(RUN): self._assign,
            keys.episode(RUN): self._take,
            keys.fault(RUN): self._hear,
        }
        self._responders = [Responder(bus, key, say, Counters()) for key, say in answers.items()]

    def publish(self, attempt: int, version: int) -> WeightBlob:
        """New weights, the same ones for the same attempt and version."""
        rng = np.random.default_rng([attempt, version])
        blob = replace(
            WeightBlob.random(self._config.network, rng), run=RUN, attempt=attempt, version=version
        )
        self.weights.publish(blob)
        return blob

    def assignment(self) -> Assignment:
        return Assignment(
            status="play",
            episode=self.episode,
            seed=episode_seed(self._config.seed, 0, self.episode),
            weights_attempt=self.attempt,
            weights_version=self.version,
            policy=self._config.policy,
            epsilon=self._config.epsilon(0),
        )

    def _assign(self, body: bytes) -> bytes:
        with self._news:
            self.asked.append(NextEpisode.decode(body))
        return self.assignment().encode()

    def _take(self, body: bytes) -> bytes:
        assert self.disk.wait(DEADLINE_S)
        episode = Episode.decode(body, self._config.task_spec)
        with self._news:
            self.delivered.append(episode)
            self._news.notify_all()
        return EpisodeReceipt(status="stored").encode()

    def _hear(self, body: bytes) -> bytes:
        fault = Fault.decode(body)
        with self._news:
            self.faults.append(fault)
            self._news.notify_all()
        return FaultReceipt().encode()

    def next_delivery(self) -> Episode:
        """The next episode that is delivered from now on."""
        with self._news:
            known = len(self.delivered)
            assert self._news.wait_for(lambda: len(self.delivered) > known, DEADLINE_S), (
                f"no episode was delivered; faults: {[fault.reason for fault in self.faults]}"
            )
            return self.delivered[known]

    def wait_faults(self, count: int) -> list[str]:
        """The reasons of the first faults, as soon as there are so many."""
        with self._news:
            assert self._news.wait_for(lambda: len(self.faults) >= count, DEADLINE_S), (
                f"{len(self.faults)} faults, {len(self.delivered)} episodes"
            )
            return [fault.reason for fault in self.faults[:count]]
