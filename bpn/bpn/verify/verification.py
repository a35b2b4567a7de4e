"""Goes through a run iteration by iteration and compares all that follows from configuration, seed and frames."""

import copy
from collections.abc import Callable
from typing import Any

import torch

from bpn.verify import draws, explanations, recorded, records, rounding
from bpn.verify.beginning import check_taken_over
from bpn.verify.findings import Findings
from bpn.verify.play import Policy, unpacked
from bpn.verify.targets import COMPUTED, Played, Targets, factor_on_rewards
from bpn.verify.trainee import Trainee, released
from bpn.verify.training import gap, learning_rate_factors, train, updates
from bpn.verify.update import Update
from bpn.verify.weights import described, digest, distance, same_bits
from bpn_shared.bnn.envelope import BlobError
from bpn_shared.bnn.weights import Weights
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.algorithms import EPSILON_GREEDY, SOFTMAX
from bpn_shared.spec.config import ConfigError, RunConfig

OnEpoch = Callable[[int, int], None]
"""Told (epochs trained again, epochs of the run)."""

TARGET_TOLERANCE = {"binary": 1e-6, "float": 1e-4}
LOSS_TOLERANCE = {"binary": 1e-6, "float": 1e-3}
WEIGHTS_TOLERANCE = 1e-3
"""Of a float network's version, relative to the weights' norm: rounding, which such networks hardly amplify."""
GRADIENT_TOLERANCE = 1e-3
"""Relative to the norm. Most minibatches are at 1e-6; one in which rounding decides a sign is not."""


class Verification:
    """Of one run.

    Args:
        elsewhere: the run was made on another kind of processor or with another torch than is here, so that
            rounding may differ.
    """

    def __init__(
        self, folder: RunFolder, *, elsewhere: bool = False, on_epoch: OnEpoch = lambda *_: None
    ) -> None:
        self.folder, self.config = folder, folder.config()
        self.findings = Findings()
        self.records = folder.metrics()
        self._on_epoch, self._epochs = on_epoch, 0
        self._network = self.config.algorithm_spec.network
        # on a GPU, and where several learners add up their parts, sums are formed in another order
        here = folder.written_by().get("torch") in (None, torch.__version__)
        alone = self.config.device == "cpu" and self.config.learners == 1
        self._repeatable = alone and here and not elsewhere
        self._trainees = [Trainee(self.config, draws.initial_seed(self.config.seed))]
        if not self._repeatable and self._network == "binary":
            self._trainees = rounding.replicas(self._trainees[0])
        self._follows = True  # whether we know what the learner's network and Adam were
        self._gaps: list[float] = []
        self._D: list[list[Played]] = []
        self._steps: list[int] = []  # transitions of every iteration

    def run(self) -> Findings:
        """Everything. Nothing is written.

        Raises:
            ConfigError: the folder holds nothing that could be verified.
        """
        torch.set_num_threads(1)  # as the learner
        policy = self._version(0)
        if policy is None:
            raise ConfigError(f"{self.folder.path} holds no weights version 0: nothing to verify")
        if self.config.init_from:
            self._follows = check_taken_over(self.folder, self._trainees, policy, self.findings)
        else:
            self._check_initial(policy)
        told, offset, factor = self.folder.rewards(), 0.0, 0.0
        for iteration, record in enumerate(self.records):
            where = f"iteration {iteration}"
            if not self.findings.compare("files", "metrics", record["iteration"], iteration):
                return self.findings
            data = recorded.played(self.folder, self.config, iteration, policy, self.findings)
            following = self._version(iteration + 1)
            if data is None or following is None:
                self.findings.compare("files", where, "incomplete", "all episodes, readable")
                return self.findings
            records.check_metrics(self.config, record, data, self.findings)
            records.check_rewards(iteration, told.get(iteration), data, self.findings)
            self._D = _newest([*self._D, data], self.config)
            self._steps.append(sum(len(episode.actions) for episode in data))
            D = [episode for dataset in self._D for episode in dataset]
            factor = self._factor(record, factor_on_rewards(self.config, D, factor))
            update = Update(self.config, iteration, record, D, policy, following, offset, factor)
            offset = self._check_update(update)
            policy = following
        # what was played with the last version, of an iteration that was not finished
        recorded.played(self.folder, self.config, len(self.records), policy, self.findings)
        self._check_gaps()
        return self.findings

    def _factor(self, record: dict[str, Any], expected: float) -> float:
        """The factor on rewards; as it was told if that is what it should be, for it may be rounded otherwise."""
        found = record.get("reward_scale", expected)  # versions before 0.2 told none
        where = f"iteration {record['iteration']}, reward_scale"
        same = self.findings.compare("targets", where, found, expected, tolerance=1e-9)
        return float(found) if same else expected

    def _version(self, version: int) -> Policy | None:
        try:
            weights: Weights = self.folder.weights(version)
        except OSError as error:
            self.findings.compare(
                "files", f"weights version {version}", str(error.strerror), "a file"
            )
            return None
        except BlobError as error:
            self.findings.compare("files", f"weights version {version}", str(error), "a policy")
            return None
        self.findings.compare("files", "weights version", weights.version, version)
        spec = self.config.network
        if not self.findings.compare("files", f"version {version}", weights.spec, spec):
            return None
        if version:
            said = self.records[version - 1]
            where = f"iteration {version - 1}"
            self.findings.compare("digests", where, said.get("weights_sha256"), digest(weights))
            self.findings.compare("digests", where, said.get("weights_version"), version)
        return unpacked(weights)

    def _check_initial(self, policy: Policy) -> None:
        own = released(self._trainees[0], None)
        near = same_bits(own, policy) or (
            distance(policy, own) <= 1e-6 and abs(policy.scale / own.scale - 1) < 1e-6
        )
        if near:
            self.findings.compare("initial weights", "version 0", True, True)
            return
        hint = ""
        for seed in (0, 1):
            other = released(Trainee(self.config, draws.initial_seed(seed)), None)
            if seed != self.config.seed and distance(policy, other) <= 1e-6:
                hint = f"they are those of seed {seed}"
        found, expected = described(policy, own)
        self.findings.compare("initial weights", "version 0", found, expected, hint=hint)
        self._follows = False

    def _check_update(self, update: Update) -> float:
        """One update, from its data to its weights; the offset of the next preferences."""
        config, where, record = self.config, update.where, update.record
        self._check_steps(update)
        found, expected = record["scale"], update.following.scale
        self.findings.compare("scale", f"{where}, lambda", found, expected, tolerance=1e-6)
        if config.algorithm_spec.targets not in COMPUTED:
            self._follows = False
            self.findings["targets"].note(_OWN_TARGETS.format(config.algorithm_spec.targets))
            self._progress(config.epochs)
            return 0.0
        data = update.targets()
        self._check_targets(update, data)
        binary = update.following.binary
        most = config.network.hidden_units * len(config.network.action_dims)
        reach = update.following.scale * most if binary else float("inf")
        expected = float((data.y.abs() > reach).float().mean())
        found = record["saturation"]
        self.findings.compare("scale", f"{where}, saturation", found, expected, tolerance=1e-3)
        if self._follows:
            self._check_training(update, data)
        else:
            self.findings["weights"].note(
                "after a difference updates are not trained again: what the learner's network and optimizer "
                "were is not known"
            )
            self._progress(config.epochs)
        return data.offset

    def _check_steps(self, update: Update) -> None:
        config, found = self.config, update.record["updates"]
        times = 2 if config.augment else 1
        size = sum(len(episode.actions) for episode in update.D)
        steps = updates(config, times * size)
        of_all = updates(config, times * sum(self._steps))
        hint = "it is that of the data sets of all iterations" if found == of_all else ""
        self.findings.compare("updates", update.where, found, steps, hint=hint)

    def _check_targets(self, update: Update, data: Targets) -> None:
        where, tolerance = update.where, TARGET_TOLERANCE[self._network]
        told = update.record["max_target"]

        def fits(other: Targets) -> bool:
            largest = float(other.y.abs().max())
            return bool(abs(largest - told) <= tolerance * max(1.0, largest))

        found = update.record["max_preference"]
        self.findings.compare(
            "targets", f"{where}, max_preference", found, data.max_preference, tolerance=tolerance
        )
        hint = "" if fits(data) else explanations.of_targets(update, fits)
        largest = float(data.y.abs().max())
        self.findings.compare(
            "targets", f"{where}, max_target", told, largest, tolerance=tolerance, hint=hint
        )

    def _check_training(self, update: Update, data: Targets) -> None:
        where, following = update.where, update.following
        before = copy.deepcopy(self._trainees[0])
        if self.config.backend == "native":
            order = draws.shuffles(self.config.seed, update.iteration).permutation(len(data.y))
            self._gaps.append(gap(before, data, torch.from_numpy(order[: self.config.batch_size])))
        losses = [
            self._trained(trainee, update.iteration, data, turned=7 * k)
            for k, trainee in enumerate(self._trainees)
        ]
        if len(self._trainees) > 1:
            self._check_within_rounding(update, data, losses)
            return
        own = released(self._trainees[0], data.seen)
        tolerance = LOSS_TOLERANCE[self._network]
        for name, loss in (("loss_first", losses[0][0]), ("loss", losses[0][-1])):
            found = update.record[name]
            self.findings.compare("losses", f"{where}, {name}", found, loss, tolerance=tolerance)
        same = same_bits(following, own)
        if same or (not own.binary and distance(following, own) <= WEIGHTS_TOLERANCE):
            self.findings.compare("weights", where, True, True)
            if not same:
                rounding.follow(self._trainees[0], following)
            return
        hint = explanations.of_weights(update, before)
        self.findings.compare("weights", where, *described(following, own), hint=hint)
        if not hint:
            self.findings["weights"].note(
                "if the run was made on another kind of processor or with another torch, add --elsewhere"
            )
        self._follows = False

    def _check_within_rounding(
        self, update: Update, data: Targets, losses: list[list[float]]
    ) -> None:
        found = rounding.distances(update, self._trainees, data, losses)
        for name, (far, allowed) in found.items():
            check, where = (
                "losses" if name.startswith("loss") else "weights",
                f"{update.where}, {name}",
            )
            if far <= allowed:
                self.findings.compare(check, where, True, True)
            else:
                self.findings.compare(check, where, f"{far:.3g} away", f"at most {allowed:.3g}")
        self.findings["weights"].note(
            "compared with three trainings that differ in rounding alone, not bit by bit"
        )
        for trainee in self._trainees:
            rounding.follow(trainee, update.following)

    def _trained(
        self, trainee: Trainee, iteration: int, data: Targets, *, turned: int
    ) -> list[float]:
        return train(
            trainee,
            data,
            explanations.backend_of(self.config)(trainee, data),
            factors=learning_rate_factors(self.config, iteration, len(data.y)),
            batch_size=self.config.batch_size,
            shuffles=draws.shuffles(self.config.seed, iteration),
            turned=turned,
            on_epoch=lambda: self._progress(0 if turned else 1),
        )

    def _progress(self, epochs: int) -> None:
        self._epochs += epochs
        self._on_epoch(self._epochs, len(self.records) * self.config.epochs)

    def _check_gaps(self) -> None:
        """The median, since in a minibatch where rounding decides a sign the gradients may differ."""
        if self._gaps:
            median = sorted(self._gaps)[len(self._gaps) // 2]
            self.findings.compare(
                "gradients",
                "median of the first minibatches",
                median if median > GRADIENT_TOLERANCE else 0.0,
                0.0,
            )
            self.findings["gradients"].note(f"median distance {median:.1g} of the norm")


_OWN_TARGETS = (
    "the targets {!r} are no part of this program: they and the training by them are not judged"
)


def what_is_trusted(config: RunConfig) -> list[str]:
    """What a run folder alone cannot show."""
    trusted = ["the frames, that each is what the camera saw after the action before it"]
    if config.task_spec.told_rewards:
        trusted.append("the rewards, which the robot tells")
    if config.init_from:
        trusted.append(
            "the latent weights that it begins with, behind the policy that was taken over"
        )
    if config.algorithm_spec.targets not in COMPUTED:
        trusted.append(f"the updates, which {config.algorithm}'s own targets decide")
    if config.policy not in (SOFTMAX, EPSILON_GREEDY):
        trusted.append(f"the actions, which {config.algorithm}'s own selection draws")
    trusted.append("whether an episode's end was the task's, and times")
    return trusted


def _newest(sets: list[list[Played]], config: RunConfig) -> list[list[Played]]:
    """Those that are D: the newest U, or as many as have `replay_transitions` together, the last one always."""
    if not config.replay_transitions:
        return sets[-config.replay_iterations :]
    while len(sets) > 1 and _steps(sets) > config.replay_transitions:
        sets = sets[1:]
    return sets


def _steps(sets: list[list[Played]]) -> int:
    return sum(len(episode.actions) for held in sets for episode in held)
