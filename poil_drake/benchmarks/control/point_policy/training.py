"""Training by behaviour cloning, and a cache of trained policies."""

import hashlib
import json
import math
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from tqdm import tqdm

from poil_drake.benchmarks.control.point_policy.network import (
    LAYER_NORM_EPSILON,
    Normalization,
    PointPolicyConfig,
    TrainedPointPolicy,
    initial_weights,
)
from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_transform import rotation_exp
from poil_drake.runtime.user_cache import cached_directory

if TYPE_CHECKING:
    import torch

TRAINING_VERSION = 3
"""Part of the cache's key. Increase it when training gives other weights or another format."""


def load_or_train(
    demonstrations: Sequence[np.ndarray], config: PointPolicyConfig
) -> TrainedPointPolicy:
    """Returns the trained policy from the user's cache. If it is missing, trains and saves it.

    Several processes may call this function at the same time.

    Args:
        demonstrations: As for `train_point_policy`.
        config: Settings of network and training.

    Raises:
        InvalidValueError: if the file in the cache is damaged.
    """

    def train(folder: Path) -> None:
        trained = train_point_policy(demonstrations, config)
        arrays = {**vars(trained.normalization), **trained.weights}
        np.savez(folder / "policy.npz", allow_pickle=False, **arrays)

    version = training_key(demonstrations, config)
    path = cached_directory(name="point_policy", version=version, make=train) / "policy.npz"
    try:
        with np.load(path) as file:
            weights = dict(file)
        normalization = Normalization(weights.pop("lower"), weights.pop("upper"))
    except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise InvalidValueError(
            f"The file '{path}' of a trained policy is damaged: {error}.",
            remedy=f"Delete the folder '{path.parent}'. The next study trains the policy again.",
        ) from error
    return TrainedPointPolicy(config, normalization, weights)


def training_key(demonstrations: Sequence[np.ndarray], config: PointPolicyConfig) -> str:
    """Returns a hash of demonstrations and settings: 32 hexadecimal digits."""
    digest = hashlib.sha256()
    settings = {"version": TRAINING_VERSION, **asdict(config)}
    digest.update(json.dumps(settings, sort_keys=True).encode())
    for demonstration in demonstrations:
        values = np.ascontiguousarray(demonstration, dtype="<f8")
        digest.update(f"{values.shape}".encode())
        digest.update(values.tobytes())
    return digest.hexdigest()[:32]


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


def cut_windows(
    demonstrations: Sequence[np.ndarray], config: PointPolicyConfig
) -> tuple[np.ndarray, np.ndarray]:
    """Returns one window for each sample of each demonstration, including rest samples.

    Each demonstration is extended by rest samples, which repeat its last sample. Where a window
    reaches beyond an end of the demonstration, it repeats the sample at that end.

    Args:
        demonstrations: (T_i, N, 3) each [m, world], the same N points in all.
        config: Lengths of history, chunk and rest.

    Returns:
        histories: (S, H, N, 3) observations, oldest first; the last one is current [m, world].
        futures: (S, K, N, 3) the positions that followed [m, world].
    """
    histories, futures = [], []
    for demonstration in demonstrations:
        now = np.arange(len(demonstration) + config.rest)[:, None]
        last = len(demonstration) - 1
        past, future = np.arange(1 - config.history, 1), np.arange(1, config.chunk + 1)
        histories.append(demonstration[np.clip(now + past, 0, last)])
        futures.append(demonstration[np.clip(now + future, 0, last)])
    return np.concatenate(histories), np.concatenate(futures)


def perturb_histories(
    histories: np.ndarray, config: PointPolicyConfig, rng: np.random.Generator
) -> np.ndarray:
    """Returns histories (B, H, N, 3) [m] as if the motion so far had strayed or stopped.

    Two random motions, each a shift and a rotation about the centroid, perturb the beginning and
    the end of a history; in between, they are interpolated linearly. So the points and their recent
    motion are off. In some histories, the points seem to have stopped. The network learns to return
    and to continue, because the futures stay the same.

    Args:
        histories: (B, H, N, 3) [m], oldest first.
        config: Noise and probability of a halt.
        rng: Source of the noise.
    """
    batch, length = histories.shape[:2]
    blend = (np.arange(length)[:, None] + 1.0) / length
    oldest, current = rng.standard_normal((2, batch, 1, 6))
    noise = (1.0 - blend) * oldest + blend * current
    R = rotation_exp(config.rotation_noise * noise[..., :3])
    centroids = histories.mean(axis=2, keepdims=True)
    rotated = (histories - centroids) @ np.swapaxes(R, -1, -2)
    perturbed = centroids + rotated + config.translation_noise * noise[..., None, 3:]
    halted = rng.random(batch) < config.halt_probability
    perturbed[halted] = perturbed[halted, -1:]
    return perturbed


def _optimize(
    first: dict[str, np.ndarray],
    batches: Iterator[tuple[np.ndarray, np.ndarray]],
    config: PointPolicyConfig,
) -> dict[str, np.ndarray]:
    """Returns the weights after one optimisation step per batch."""
    import torch

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
            outputs = torch_forward(weights(), torch.as_tensor(inputs), config)
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


def torch_forward(
    weights: Mapping[str, "torch.Tensor"], inputs: "torch.Tensor", config: PointPolicyConfig
) -> "torch.Tensor":
    """Returns the outputs (B, N, 3 `chunk`) for a batch of inputs (B, N, 3 `history`).

    It is `network.forward` in torch, for gradients.
    """
    from torch.nn import functional

    def linear(x: "torch.Tensor", name: str) -> "torch.Tensor":
        return functional.linear(x, weights[f"{name}.w"], weights[f"{name}.b"])

    def normalized(x: "torch.Tensor") -> "torch.Tensor":
        return functional.layer_norm(x, x.shape[-1:], eps=LAYER_NORM_EPSILON)

    x = linear(inputs, "embed") + weights["identity"]
    batch, points, width = x.shape
    for k in range(config.layers):
        attend = linear(normalized(x), f"{k}.attend")
        split = attend.view(batch, points, 3, config.heads, -1).permute(2, 0, 3, 1, 4)
        mixed = functional.scaled_dot_product_attention(*split.unbind(0))
        x = x + linear(mixed.transpose(1, 2).reshape(batch, points, width), f"{k}.mix")
        hidden = functional.silu(linear(normalized(x), f"{k}.up"))
        x = x + linear(hidden, f"{k}.down")
    return linear(normalized(x), "head")
