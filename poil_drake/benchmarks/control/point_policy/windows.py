"""Demonstrations cut into what the network sees and what it shall predict."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_transform import rotation_exp


@dataclass(frozen=True, eq=False)
class Windows:
    """Samples to train on.

    Attributes:
        histories: (S, H, N, 3) observations, oldest first, the last one current [m, world].
        futures: (S, K, N, 3) the positions that followed [m, world].
    """

    histories: np.ndarray
    futures: np.ndarray


def cut_windows(
    demonstrations: Sequence[np.ndarray], *, history: int, chunk: int, rest: int
) -> Windows:
    """Returns one window for each sample of each demonstration, samples at rest included.

    Before the first sample, the first is repeated, as the policy does before its history is full;
    behind the last, the last.

    Args:
        demonstrations: (T_i, N, 3) each [m, world], the same N points in all.
        history: H, observations in a window.
        chunk: K, positions to predict.
        rest: Samples at rest appended to each demonstration.

    Raises:
        InvalidValueError: if there is no demonstration, shapes disagree or a number is not finite.
    """
    if not demonstrations:
        raise InvalidValueError(
            "Point Policy got no demonstration.", remedy="Pass one or more, each (T, N, 3)."
        )
    points = demonstrations[0].shape[1:2]
    histories, futures = [], []
    for k, demonstration in enumerate(demonstrations):
        if demonstration.ndim != 3 or demonstration.shape[1:] != (*points, 3):
            raise InvalidValueError(
                f"Demonstration {k} has shape {demonstration.shape}.",
                remedy="Pass (T, N, 3), the same N points in all demonstrations.",
            )
        if len(demonstration) < 2 or not np.isfinite(demonstration).all():
            raise InvalidValueError(
                f"Demonstration {k} has {len(demonstration)} samples, or numbers that are not "
                "finite.",
                remedy="Pass 2 samples or more with every point in each.",
            )
        now = np.arange(len(demonstration) + rest)[:, None]
        last = len(demonstration) - 1
        histories.append(demonstration[np.clip(now + np.arange(1 - history, 1), 0, last)])
        futures.append(demonstration[np.clip(now + np.arange(1, chunk + 1), 0, last)])
    return Windows(np.concatenate(histories), np.concatenate(futures))


def perturb_histories(
    histories: np.ndarray,
    *,
    translation_noise: float,
    rotation_noise: float,
    halt_probability: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """Returns histories (B, H, N, 3) [m] as if the motion so far had strayed or stopped.

    The current observation and the one before the oldest are shifted, and turned about their
    centroids, at random and independently, those in between by interpolation: both where the points
    are and how they got there are off. Some seem to have been where they are all the time. As the
    futures stay, the network learns to return and to go on.

    Args:
        histories: (B, H, N, 3) [m], oldest first.
        translation_noise: Standard deviation of the shift along each axis [m].
        rotation_noise: Standard deviation of the turn about each axis [rad].
        halt_probability: Of a history that stood still.
        rng: Where chance comes from.
    """
    batch, length = histories.shape[:2]
    blend = (np.arange(length)[:, None] + 1.0) / length
    oldest, current = rng.standard_normal((2, batch, 1, 6))
    strayed = (1.0 - blend) * oldest + blend * current
    R = rotation_exp(rotation_noise * strayed[..., :3])
    centroids = histories.mean(axis=2, keepdims=True)
    turned = (histories - centroids) @ np.swapaxes(R, -1, -2)
    perturbed = centroids + turned + translation_noise * strayed[..., None, 3:]
    halted = rng.random(batch) < halt_probability
    perturbed[halted] = perturbed[halted, -1:]
    return perturbed
