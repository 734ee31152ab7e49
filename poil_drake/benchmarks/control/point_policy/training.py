"""Training by behaviour cloning."""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from tqdm import tqdm

from poil_drake.benchmarks.control.point_policy.config import PointPolicyConfig
from poil_drake.benchmarks.control.point_policy.network import initial_weights
from poil_drake.benchmarks.control.point_policy.normalization import Normalization
from poil_drake.benchmarks.control.point_policy.trained import TrainedPointPolicy, network_shapes
from poil_drake.benchmarks.control.point_policy.windows import cut_windows, perturb_histories

_STRETCHES = 20
"""Over how many parts of the training the loss is averaged for the record."""

_Batch = tuple[np.ndarray, np.ndarray]


def train_point_policy(
    demonstrations: Sequence[np.ndarray], config: PointPolicyConfig | None = None
) -> TrainedPointPolicy:
    """Returns a policy that imitates demonstrations.

    Minimises the mean squared error of the normalised future positions, as published: what is
    learnt is where the points were in the world, not how they moved. The same demonstrations and
    settings give the same weights on the same machine.

    Args:
        demonstrations: (T_i, N, 3) each [m, world], sampled every `config.period`, the same N
            points in all. Where one ends, it stays.
        config: Parameters, None for the defaults.

    Raises:
        InvalidValueError: if there is no demonstration, shapes disagree or a number is not finite.
    """
    config = config or PointPolicyConfig()
    windows = cut_windows(
        [np.asarray(demonstration, dtype=float) for demonstration in demonstrations],
        history=config.history,
        chunk=config.chunk,
        rest=config.rest,
    )
    normalization = Normalization.of(windows)
    rng = np.random.default_rng(config.seed)

    def draw() -> _Batch:
        chosen = rng.integers(len(windows.histories), size=config.batch)
        histories = perturb_histories(
            windows.histories[chosen],
            translation_noise=config.translation_noise,
            rotation_noise=config.rotation_noise,
            halt_probability=config.halt_probability,
            rng=rng,
        )
        futures = windows.futures[chosen]
        return normalization.inputs(histories), normalization.targets(futures)

    batches = (draw() for _ in range(config.steps))
    first = initial_weights(network_shapes(config, windows.histories.shape[2]), config.seed)
    with _torch_threads(config.threads):
        weights, losses = _optimize(first, batches, config)
    stretches = np.array_split(losses, min(_STRETCHES, config.steps))
    return TrainedPointPolicy(
        config, normalization, weights, np.array([stretch.mean() for stretch in stretches])
    )


def learning_rate_factor(step: int, *, steps: int, warm_up: float) -> float:
    """Returns the part of the learning rate in a step: a linear rise, then half a cosine to 0.

    Args:
        step: From 0 to `steps` - 1.
        steps: Of the whole training.
        warm_up: Part of them in which the rate rises.
    """
    rise = math.floor(warm_up * steps)
    if step < rise:
        return (step + 1) / (rise + 1)
    return 0.5 + 0.5 * math.cos(math.pi * (step - rise) / (steps - rise))


def _optimize(
    first: dict[str, np.ndarray], batches: Iterator[_Batch], config: PointPolicyConfig
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Returns the weights after a step on each batch, and the losses before each step."""
    import torch

    from poil_drake.benchmarks.control.point_policy.torch_network import forward
    from poil_drake.transfer.registration.adam import Adam

    # One parameter for all weights, so that the optimiser takes one step, not one for each.
    flat = torch.nn.Parameter(torch.as_tensor(np.concatenate([w.ravel() for w in first.values()])))
    sizes = [w.size for w in first.values()]
    optimizer = Adam([flat], learning_rate=config.learning_rate)
    losses: list[float] = []
    for inputs, targets in tqdm(
        batches, total=config.steps, desc="training Point Policy", leave=False, disable=None
    ):
        weights = {
            name: part.view(w.shape)
            for (name, w), part in zip(first.items(), flat.split(sizes), strict=True)
        }
        outputs = forward(weights, torch.as_tensor(inputs), config.heads)
        loss = (outputs - torch.as_tensor(targets)).square().mean()
        optimizer.zero_grad()
        loss.backward()
        factor = learning_rate_factor(len(losses), steps=config.steps, warm_up=config.warm_up)
        losses.append(loss.item())
        before = flat.detach().clone()
        optimizer.step()
        # Adam's step is proportional to its rate, so a part of the step is a lower rate.
        with torch.no_grad():
            flat.lerp_(before, 1.0 - factor)
    parts = flat.detach().split(sizes)
    trained = {
        name: part.numpy().reshape(w.shape).copy()
        for (name, w), part in zip(first.items(), parts, strict=True)
    }
    return trained, np.array(losses)


@contextmanager
def _torch_threads(count: int) -> Iterator[None]:
    """Lets torch use some number of threads for a while."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
