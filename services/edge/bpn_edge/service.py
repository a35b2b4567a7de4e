"""`bpn-edge`: the policy at the robot. Frames in, actions out; episodes to the learner."""

import logging
from collections.abc import Sequence
from contextlib import closing
from functools import partial

from bpn_edge.decisions import DecisionFeed
from bpn_edge.driver import EpisodeDriver, EpisodeFault
from bpn_edge.kernel import usable_kernels
from bpn_edge.kernel.choice import add_kernel, choose_kernel, kernels_here
from bpn_edge.learner_link import LearnerLink, Pace
from bpn_edge.memory import WeightMemory
from bpn_edge.policy import action_selector
from bpn_edge.robot_link import RobotLink
from bpn_shared import plugins
from bpn_shared.bnn.weights import Weights
from bpn_shared.bus.weights import WeightsSubscriber
from bpn_shared.errors import InputError
from bpn_shared.runtime.collector import Collector
from bpn_shared.runtime.entry import run_slot_worker, slot_options, slot_parser
from bpn_shared.runtime.faults import FaultReporter
from bpn_shared.runtime.leased import Abilities
from bpn_shared.runtime.worker import EXIT_FINISHED, Worker
from bpn_shared.spec.config import RunConfig

log = logging.getLogger(__name__)

_WEIGHTS_TIMEOUT_S = 1.0


def serve(
    worker: Worker, config: RunConfig, kernels: Sequence[str] = (), *, past_router: bool = True
) -> int:
    """Plays what the learner assigns, until there is no more or the worker is stopped.

    Args:
        kernels: what this edge was set up with.
        past_router: see `RobotLink`.

    Raises:
        ConfigError: the run asks for another kernel, or for a selection that is not installed here.
    """
    task, faults = config.task_spec, FaultReporter(worker)
    memory = _memory(worker, config, kernels)

    def take(weights: Weights) -> None:
        if memory.offer(weights):
            worker.weights.record("loaded", weights)

    subscriber = WeightsSubscriber(
        worker.bus,
        worker.run,
        config.network,
        take,
        worker.counters,
        held=lambda: memory.rank,
        kind=config.algorithm_spec.network,
    )
    with (
        closing(DecisionFeed(worker)) as feed,
        RobotLink(worker, task, past_router=past_router) as link,
        Collector() as collector,
    ):
        driver = EpisodeDriver(
            worker,
            config,
            link,
            memory,
            feed,
            silence_s=config.longest_silence_s,
        )
        learner, pace = LearnerLink(worker), Pace()
        while not worker.stop.is_set():
            collector.collect()
            newest = memory.newest
            assignment = learner.next_episode(newest)
            if assignment is None:
                break
            if assignment.status == "finished":  # what is in hand is nobody's wish any more
                log.info("the run is finished")
                break
            if assignment.status == "wait":
                learner.deliver()
                worker.waiting.set(assignment.reason)
                if memory.wait_newer(newest, pace.next_pause_s()):  # the update is done
                    pace.reset()
                continue
            pace.reset()
            at = assignment.iteration, assignment.episode
            version, attempt = assignment.weights_version, assignment.weights_attempt
            if not memory.activate(version, _WEIGHTS_TIMEOUT_S, attempt=attempt):
                learner.deliver()
                hopeless = memory.why_never(version)
                worker.waiting.set(hopeless or f"weights version {version} of attempt {attempt}")
                if hopeless is not None:
                    faults.tell(*at, hopeless)
                subscriber.refresh()
                continue
            worker.waiting.done()
            assert memory.weights is not None  # activate() said so
            worker.weights.record("running", memory.weights)
            feed.scale = memory.weights.scale
            try:
                choose = action_selector(config, assignment, memory.weights.scale)
                episode = driver.play(assignment, choose, meanwhile=learner.deliver)
                # What a damaged bank played is no data: it is asked for, and played, again.
                if episode is not None and memory.is_intact():
                    learner.take_in_hand(episode)
            except EpisodeFault as fault:
                faults.tell(*at, str(fault))
    return EXIT_FINISHED


def _memory(worker: Worker, config: RunConfig, kernels: Sequence[str]) -> WeightMemory:
    """Both banks, once it is known that this edge can play the run."""
    plugins.find(plugins.SELECTIONS, config.policy)
    kernel = choose_kernel(config.kernel, config.algorithm_spec.network, kernels)
    log.info("kernel %s", kernel)
    return WeightMemory(kernel, worker.counters)


def main(argv: list[str] | None = None) -> int:
    """The edge service."""
    parser = slot_parser("edge", __doc__)
    add_kernel(parser)
    parser.add_argument(
        "--by-router",
        action="store_true",
        help="send everything through the router, even where the robot is on the same machine",
    )
    options = slot_options(parser, argv)
    try:
        kernels = kernels_here(options.kernel)
    except InputError as error:
        parser.error(str(error))
    abilities = Abilities(
        plugins={
            plugins.KERNELS.name: kernels or usable_kernels(),
            plugins.SELECTIONS.name: plugins.names(plugins.SELECTIONS),
        }
    )
    play = partial(serve, kernels=kernels, past_router=not options.by_router)
    return run_slot_worker("edge", options, play, abilities=abilities)
