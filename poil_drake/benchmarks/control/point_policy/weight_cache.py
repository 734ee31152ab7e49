"""Trained policies, cached by what they were trained on."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict

import numpy as np

from poil_drake.benchmarks.control.point_policy.config import PointPolicyConfig
from poil_drake.benchmarks.control.point_policy.trained import TrainedPointPolicy
from poil_drake.benchmarks.control.point_policy.training import train_point_policy
from poil_drake.runtime.user_cache import cached_directory

TRAINING_VERSION = 3
"""To be increased when the same data and settings give other weights or another file."""

_FILE = "policy.npz"


def load_or_train(
    demonstrations: Sequence[np.ndarray], config: PointPolicyConfig
) -> TrainedPointPolicy:
    """Returns the policy trained on these demonstrations, from the user's cache if it is there.

    Several processes may train the same policy at the same time.

    Args:
        demonstrations: As `train_point_policy` takes them.
        config: Settings of network and training.

    Raises:
        InvalidValueError: if the file in the cache is damaged.
    """
    folder = cached_directory(
        name="point_policy",
        version=training_key(demonstrations, config),
        make=lambda folder: train_point_policy(demonstrations, config).save(folder / _FILE),
    )
    return TrainedPointPolicy.load(folder / _FILE, config)


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
