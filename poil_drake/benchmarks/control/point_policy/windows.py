"""Demonstrations cut into windows: the network's inputs and the positions to predict."""

from collections.abc import Sequence

import numpy as np

from poil_drake.benchmarks.control.point_policy.config import PointPolicyConfig
from poil_drake.geometry.rigid_transform import rotation_exp


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
