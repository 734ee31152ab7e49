"""A cache of trained policies, by demonstrations and settings."""

import hashlib
import json
import zipfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from poil_drake.benchmarks.control.point_policy.config import PointPolicyConfig
from poil_drake.benchmarks.control.point_policy.trained import Normalization, TrainedPointPolicy
from poil_drake.benchmarks.control.point_policy.training import train_point_policy
from poil_drake.errors import InvalidValueError
from poil_drake.runtime.output_files import cached_directory

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
