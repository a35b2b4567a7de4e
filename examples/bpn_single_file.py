"""Binarized P-Network in one file: plain torch, no bus, no services, for reading from top to bottom.

    python examples/bpn_single_file.py --task reaching --iterations 10

It is the algorithm of `bpn train --backend torch`, and with the same options it ends with the same bits:
the digest that it prints after each iteration is the run's `weights_sha256`. Equations are those of Kadokawa,
Tsurumine and Matsubara, "Binarized P-Network", 2021. From the project come only the task: its simulated robot, its
rewards from pixels, its preset.
"""

import argparse
import hashlib
import math
import struct
from dataclasses import dataclass

import numpy as np
import torch
from torch.nn.functional import batch_norm, conv2d, linear

from bpn_robot.robots import make_robot
from bpn_shared.spec.installed import task_spec
from bpn_shared.spec.rewards import reward_function
from bpn_shared.spec.tasks import TaskOptions

CONVOLUTIONS = [(8, 4, 8), (4, 2, 16), (3, 1, 16)]  # kernel, stride, output channels
IMAGE_PX, BLACK_TO_WHITE = 84, 255
LATENT_INITIAL, SCALE_RATE_FACTOR, EPSILON = 0.1, 3.0, 1e-5
EPISODE, ACTION, SHUFFLE, INITIAL = range(4)  # what random numbers are for


@dataclass
class Settings:
    """Table I of the paper, and what it leaves open; a task's preset changes some."""

    seed: int = 0
    iterations: int = 50
    episodes: int = 10
    steps: int = 20
    epochs: int = 50
    batch_size: int = 32
    replay_iterations: int = 3  # U: data sets that an update learns from
    alpha: float = 0.95
    beta: float = 1.0
    gamma: float = 0.99
    bootstrap_terminals: bool = True
    relative_targets: bool = False
    hidden_units: int = 100
    learning_rate: float = 1e-3
    lr_update_final_factor: float = 0.02  # share of it at an update's end
    lr_run_final_factor: float = 0.1  # share of it in the last iteration
    scale_initial: float = 0.2
    reward_scale: float = 0.1


class Sign(torch.autograd.Function):
    """+1 where x >= 0, else -1; the gradient passes where |x| <= 1 (straight through)."""

    @staticmethod
    def forward(ctx, x):
        ctx.save_for_backward(x)
        return torch.where(x >= 0, 1.0, -1.0).to(x.dtype)

    @staticmethod
    def backward(ctx, gradient):
        (x,) = ctx.saved_tensors
        return gradient * (x.abs() <= 1)


class Network:
    """Five binarized layers; batch norm and Sign follow the first four; P = lambda o_5 (Eq. 11 to 14)."""

    def __init__(self, channels, hidden_units, actions, scale, generator):
        self.layers, size, inputs = [], IMAGE_PX, channels  # kernel, stride, inputs, outputs
        for kernel, stride, outputs in CONVOLUTIONS:
            self.layers.append((kernel, stride, inputs, outputs))
            size, inputs = (size - kernel) // stride + 1, outputs
        self.layers += [
            (size, 1, inputs, hidden_units),
            (1, 1, hidden_units, actions),
        ]  # fully connected
        self.fan_in = [kernel * kernel * inputs for kernel, _, inputs, _ in self.layers]
        self.outputs = [outputs for *_, outputs in self.layers]
        self.sizes = [n * m for n, m in zip(self.fan_in, self.outputs, strict=True)]
        latent = torch.empty(sum(self.sizes))
        self.latent = latent.uniform_(-LATENT_INITIAL, LATENT_INITIAL, generator=generator)
        channels = sum(self.outputs[:-1])
        self.gain, self.bias = torch.ones(channels), torch.zeros(channels)
        self.log_scale = torch.tensor(scale).log()
        self.mean = torch.zeros(channels, dtype=torch.float64)
        # before any data: what random signs give, with inputs +-1 or pixels uniform in 0..255
        most = [BLACK_TO_WHITE**2 / 3, 1, 1, 1]
        of = zip(self.outputs[:-1], self.fan_in[:-1], most, strict=True)
        self.var = torch.cat([torch.full((c,), n * m, dtype=torch.float64) for c, n, m in of])
        self.parameters = [self.latent, self.gain, self.bias, self.log_scale]
        for parameter in self.parameters:
            parameter.requires_grad_()

    def signs(self):
        """Per layer [out, fan_in], in the order kernel row, kernel column, input channel."""
        parts = torch.split(Sign.apply(self.latent), self.sizes)
        return [w.view(m, n) for w, m, n in zip(parts, self.outputs, self.fan_in, strict=True)]

    def sums(self, index, signs, x):
        """O of a layer: [B, in, h, w] to [B, out, h', w']."""
        kernel, stride, inputs, outputs = self.layers[index]
        if x.shape[-1] == kernel:
            return linear(x.permute(0, 2, 3, 1).flatten(1), signs)[:, :, None, None]
        kernels = signs.view(outputs, kernel, kernel, inputs).permute(0, 3, 1, 2)
        return conv2d(x, kernels, stride=stride)

    def train_preferences(self, pixels):
        """P of a minibatch with its own batch statistics."""
        signs, x = self.signs(), pixels
        norms = [torch.split(part, self.outputs[:-1]) for part in (self.gain, self.bias)]
        for index, (gain, bias) in enumerate(zip(*norms, strict=True)):
            o = self.sums(index, signs[index], x)
            x = Sign.apply(batch_norm(o, None, None, gain, bias, training=True, eps=EPSILON))
        return self.log_scale.exp() * self.sums(4, signs[4], x).flatten(1)

    def affine(self):
        """A, b of each hidden layer: evaluated, an activation is Sign(a o + b)."""
        a = self.gain.detach().double() / torch.sqrt(self.var + EPSILON)
        b = self.bias.detach().double() - a * self.mean
        return list(
            zip(torch.split(a, self.outputs[:-1]), torch.split(b, self.outputs[:-1]), strict=True)
        )

    @torch.no_grad()
    def evaluated(self, pixels):
        """The last layer's integers o_5 of the network as the robot runs it, [B, |A|]."""
        signs, x = self.signs(), pixels.float()
        for index, (a, b) in enumerate(self.affine()):
            x = active(a, b, self.sums(index, signs[index], x).round())
        return self.sums(4, signs[4], x).round().flatten(1)

    @torch.no_grad()
    def calibrate(self, pixels):
        """Batch norm's mean and variance over all of D, for the weights as they are now, layer by layer."""
        signs, first = self.signs(), 0
        parts = [part.float() for part in torch.split(pixels, 256)]
        for index, outputs in enumerate(self.outputs[:-1]):
            sums = [self.sums(index, signs[index], part).round() for part in parts]
            whole = torch.cat([o.transpose(0, 1).flatten(1) for o in sums], dim=1).long()
            n, channels = whole.shape[1], slice(first, first + outputs)
            pairs = list(zip(whole.sum(1).tolist(), whole.square().sum(1).tolist(), strict=True))
            self.mean[channels] = torch.tensor([s / n for s, _ in pairs], dtype=torch.float64)
            spread = [
                (n * q - s * s) / (n * n) for s, q in pairs
            ]  # exact until here: Python's integers
            self.var[channels] = torch.tensor(spread, dtype=torch.float64)
            a, b = self.affine()[index]
            parts, first = [active(a, b, o) for o in sums], first + outputs

    @torch.no_grad()
    def folded(self):
        """Signs int8 and integer thresholds: x = +1 iff o >= tau. Where a < 0 the signs are turned instead."""
        signs = [w.numpy().astype(np.int8) for w in self.signs()]
        thresholds = []
        for index, (a, b) in enumerate(self.affine()):
            signs[index][a.numpy() < 0] *= -1
            limit = self.fan_in[index] * (BLACK_TO_WHITE if index == 0 else 1)
            o = torch.arange(-limit, limit + 1, dtype=torch.float64)
            on = a.abs()[:, None] * o + b[:, None] >= 0
            first = torch.where(on.any(1), on.long().argmax(1), len(o))
            thresholds.append((first - limit).numpy().astype("<i4"))
        return signs, thresholds

    def digest(self):
        """SHA-256 of what the policy computes."""
        signs, thresholds = self.folded()
        sizes = (
            self.layers[0][2],
            self.outputs[3],
            self.outputs[4],
            float(self.log_scale.detach().exp()),
        )
        digest = hashlib.sha256(struct.pack("<HHHf", *sizes))
        for weights in signs:
            digest.update(np.packbits(weights > 0, bitorder="little").tobytes())
        for tau in thresholds:
            digest.update(tau.tobytes())
        return digest.hexdigest()


def active(a, b, o):
    """Sign(a o + b) in float64: [B, out, h, w]."""
    return torch.where(a[:, None, None] * o.double() + b[:, None, None] >= 0, 1.0, -1.0)


def generator(*key):
    """Every random number is a function of what it is for, the run's seed, and where it is used."""
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(key)))


def play(robot, task, network, settings, place):
    """An episode in lockstep, actions drawn from the softmax policy (Eq. 9); `place` is (iteration, episode)."""
    seed = int(generator(EPISODE, settings.seed, *place).integers(2**64, dtype=np.uint64))
    philox = np.random.Philox(key=np.array([seed, ACTION], np.uint64))
    uniforms = np.random.Generator(philox).random((settings.steps, 4))[:, 0]
    scale = float(network.log_scale.detach().exp())
    frames, actions = [robot.reset(seed)], []
    for uniform in uniforms:
        o = network.evaluated(stacked(frames, task.frames_stacked)[-1:])[0].tolist()
        action = drawn([math.exp(settings.beta * scale * (value - max(o))) for value in o], uniform)
        robot.command(action)
        robot.settle()
        frames.append(robot.frame())
        actions.append(action)
        if robot.terminated:
            break
    seen, taken = stacked(frames, task.frames_stacked), torch.tensor(actions)
    rewards = reward_function(task)(np.stack(frames), task)
    done = torch.zeros(len(actions), dtype=torch.bool)
    done[-1] = robot.terminated
    return seen, taken, rewards, done


def drawn(weights, uniform):
    """The number of the weight in which a uniform share of their sum lies."""
    remaining = uniform * sum(weights)
    for number, weight in enumerate(weights):
        remaining -= weight
        if remaining < 0:
            return number
    return len(weights) - 1


def stacked(frames, count):
    """Observations uint8[T+1, C, 84, 84] of frames, the first one repeated at the start."""
    indices = [
        [max(0, step - back) for back in reversed(range(count))] for step in range(len(frames))
    ]
    return torch.from_numpy(np.stack([np.concatenate([frames[i] for i in row]) for row in indices]))


def mellowmax(P, beta):
    """1/beta log mean_a exp(beta P(s, a)) (Eq. 8)."""
    top = P.amax(dim=-1, keepdim=True)
    excess = torch.expm1(beta * (P - top)).mean(dim=-1)
    return top.squeeze(-1) + torch.log1p(excess) / beta


def cvi_targets(network, D, settings, offset):
    """Y = r + gamma m(s') + alpha (P(s, a) - m(s)) of every transition, and what its mean leaves out."""
    scale = network.log_scale.detach().exp()
    P_of = [scale * network.evaluated(seen) for seen, *_ in D]
    P, P_next = torch.cat([p[:-1] for p in P_of]), torch.cat([p[1:] for p in P_of])
    actions = torch.cat([taken for _, taken, *_ in D])
    scaled = [rewards * settings.reward_scale for _, _, rewards, _ in D]
    reward = torch.from_numpy(np.concatenate(scaled).astype(np.float32))
    following = mellowmax(P_next, settings.beta)
    if not settings.bootstrap_terminals:
        following = following.masked_fill(torch.cat([done for *_, done in D]), -offset)
    taken = P.gather(-1, actions.unsqueeze(-1)).squeeze(-1)
    gap = settings.alpha * (taken - mellowmax(P, settings.beta))
    y = reward + settings.gamma * following + gap
    if not settings.relative_targets:
        return actions, y, 0.0
    return actions, y - y.mean(), settings.gamma * offset + float(y.mean())


def update(network, adam, D, settings, *, iteration, offset):
    """One policy update (Algorithm 1): C epochs of minibatches, then statistics and thresholds anew."""
    actions, y, offset = cvi_targets(network, D, settings, offset)
    observations = torch.cat([seen[:-1] for seen, *_ in D])
    pixels = observations.permute(0, 2, 3, 1).contiguous()
    size, B = len(y), settings.batch_size
    minibatches = max(1, (2 * size + B - 1) // (2 * B))
    line = 1 + iteration / max(1, settings.iterations - 1) * (settings.lr_run_final_factor - 1)
    shuffle = generator(SHUFFLE, settings.seed, iteration)
    for epoch in range(settings.epochs):
        progress, final = epoch / max(1, settings.epochs - 1), settings.lr_update_final_factor
        cosine = final + (1 - final) * (1 + math.cos(math.pi * progress)) / 2
        for group, rate in zip(adam.param_groups, (1.0, SCALE_RATE_FACTOR), strict=True):
            group["lr"] = line * cosine * (settings.learning_rate * rate)
        order, total = torch.from_numpy(shuffle.permutation(size)), 0.0
        for k in range(minibatches):
            rows = order[B * k : B * (k + 1)]
            P = network.train_preferences(pixels[rows].float().permute(0, 3, 1, 2))
            taken = P.gather(1, actions[rows, None]).squeeze(1)
            loss = (y[rows] - taken).square().sum() / (2 * len(rows))
            adam.zero_grad()
            loss.backward()
            adam.step()
            with torch.no_grad():
                network.latent.clamp_(-1, 1)
            total += float(loss.detach())
    network.calibrate(observations)
    return total / minibatches, offset


def train(name, settings):
    """All iterations; yields (iteration, mean return, loss, digest of the weights)."""
    torch.set_num_threads(1)  # or sums are in another order
    task = task_spec(name, TaskOptions())
    robot = make_robot(task)
    seed = int(generator(INITIAL, settings.seed).integers(2**63))
    channels = task.frame_channels * task.frames_stacked
    initial = torch.Generator().manual_seed(seed)
    network = Network(
        channels, settings.hidden_units, task.actions, settings.scale_initial, initial
    )
    *vectors, log_scale = network.parameters
    adam = torch.optim.Adam([{"params": vectors}, {"params": [log_scale]}], fused=True)
    D, offset = [], 0.0
    for iteration in range(settings.iterations):
        places = [(iteration, episode) for episode in range(settings.episodes)]
        newest = [play(robot, task, network, settings, place) for place in places]
        D = [*D, newest][-settings.replay_iterations :]
        data = [episode for dataset in D for episode in dataset]
        loss, offset = update(network, adam, data, settings, iteration=iteration, offset=offset)
        returns = [float(rewards.sum()) for _, _, rewards, _ in D[-1]]
        yield iteration, sum(returns) / len(returns), loss, network.digest()
    robot.close()


def main():
    parser = argparse.ArgumentParser(
        description="BPN in one file; the digests are those of bpn train --backend torch."
    )
    parser.add_argument("--task", default="reaching", help="reaching or tracking")
    for name, value in vars(Settings()).items():
        if not isinstance(value, bool):
            parser.add_argument(f"--{name.replace('_', '-')}", type=type(value))
    options = vars(parser.parse_args())
    name = options.pop("task")
    known = vars(Settings())
    preset = {k: v for k, v in task_spec(name, TaskOptions()).preset.items() if k in known}
    given = {k: v for k, v in options.items() if v is not None}
    for iteration, mean_return, loss, digest in train(name, Settings(**{**preset, **given})):
        print(
            f"iteration {iteration + 1:3d}  return {mean_return:8.1f}  loss {loss:8.4f}  {digest}",
            flush=True,
        )


if __name__ == "__main__":
    main()
