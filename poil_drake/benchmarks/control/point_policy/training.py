"""Training by behaviour cloning."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from tqdm import tqdm

from poil_drake.benchmarks.control.point_policy.config import PointPolicyConfig
from poil_drake.benchmarks.control.point_policy.network import initial_weights
from poil_drake.benchmarks.control.point_policy.trained import Normalization, TrainedPointPolicy
from poil_drake.benchmarks.control.point_policy.windows import cut_windows, perturb_histories


def train_point_policy(
    demonstrations: Sequence[np.ndarray], config: PointPolicyConfig
) -> TrainedPointPolicy:
    """Returns a policy that imitates demonstrations.

    As published, training minimises the mean squared error of normalised future positions. So the
    network learns where the points were in the world, not how they moved. On one machine, the same
    demonstrations and settings give the same weights.

    Args:
        demonstrations: (T_i, N, 3) each [m, world], finite, with one sample per `config.period` and
            the same N points in all. Points are taken to rest after the last sample.
        config: Settings of network and training.
    """
    histories, futures = cut_windows(demonstrations, config)
    normalization = Normalization.of(demonstrations)
    rng = np.random.default_rng(config.seed)

    def draw() -> tuple[np.ndarray, np.ndarray]:
        chosen = rng.integers(len(histories), size=config.batch)
        perturbed = perturb_histories(histories[chosen], config, rng)
        return normalization.numbers(perturbed), normalization.numbers(futures[chosen])

    first = initial_weights(config, points=histories.shape[2])
    weights = _optimize(first, (draw() for _ in range(config.steps)), config)
    return TrainedPointPolicy(config, normalization, weights)


def learning_rate_factor(step: int, config: PointPolicyConfig) -> float:
    """Returns a step's factor on the learning rate: a linear rise, then half a cosine down to 0."""
    rise = math.floor(config.warm_up * config.steps)
    if step < rise:
        return (step + 1) / (rise + 1)
    return 0.5 + 0.5 * math.cos(math.pi * (step - rise) / (config.steps - rise))


def _optimize(
    first: dict[str, np.ndarray],
    batches: Iterator[tuple[np.ndarray, np.ndarray]],
    config: PointPolicyConfig,
) -> dict[str, np.ndarray]:
    """Returns the weights after one optimisation step per batch."""
    import torch

    from poil_drake.benchmarks.control.point_policy.torch_network import forward
    from poil_drake.transfer.registration_network import Adam

    # All weights are one parameter, so that the optimiser takes one step instead of one for each.
    flat = torch.nn.Parameter(torch.as_tensor(np.concatenate([w.ravel() for w in first.values()])))
    sizes = [w.size for w in first.values()]

    def weights() -> dict[str, torch.Tensor]:
        parts = zip(first.items(), flat.split(sizes), strict=True)
        return {name: part.view(w.shape) for (name, w), part in parts}

    bar = tqdm(batches, total=config.steps, desc="training Point Policy", leave=False, disable=None)
    optimizer, threads = Adam([flat], learning_rate=config.learning_rate), torch.get_num_threads()
    torch.set_num_threads(1)  # More threads do not speed up so small a network.
    try:
        for step, (inputs, targets) in enumerate(bar):
            outputs = forward(weights(), torch.as_tensor(inputs), config)
            loss = (outputs - torch.as_tensor(targets)).square().mean()
            optimizer.zero_grad()
            loss.backward()
            before = flat.detach().clone()
            optimizer.step()
            # Adam's step is proportional to its rate, so a share of the step is a lower rate.
            with torch.no_grad():
                flat.lerp_(before, 1.0 - learning_rate_factor(step, config))
    finally:
        torch.set_num_threads(threads)
    return {name: part.detach().numpy().copy() for name, part in weights().items()}
