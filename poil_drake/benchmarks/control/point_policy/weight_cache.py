"""Trained policies kept by what they were trained on."""

import hashlib
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from tqdm import tqdm

from poil_drake.benchmarks.control.point_policy.config import PointPolicyConfig
from poil_drake.benchmarks.control.point_policy.trained import TrainedPointPolicy
from poil_drake.benchmarks.control.point_policy.training import train_point_policy
from poil_drake.errors import InvalidValueError
from poil_drake.runtime.output_files import whole_file
from poil_drake.runtime.user_cache import user_cache_directory

TRAINING_VERSION = 2
"""Goes up when the same data and settings give other weights."""


def load_or_train(
    demonstrations: Sequence[np.ndarray],
    config: PointPolicyConfig | None = None,
    cache_dir: Path | None = None,
) -> TrainedPointPolicy:
    """Returns the policy trained on these demonstrations, from the cache where it is there.

    A file appears whole or not at all, so that processes may train the same policy at one time. A
    damaged one is replaced, with a note on stderr.

    Args:
        demonstrations: As `train_point_policy` takes them.
        config: Parameters, None for the defaults.
        cache_dir: Where the files are, None for "point_policy" in the user's cache.

    Raises:
        InvalidValueError: if there is no demonstration, shapes disagree or a number is not finite.
    """
    config = config or PointPolicyConfig()
    folder = cache_dir or user_cache_directory() / "point_policy"
    path = folder / f"{training_key(demonstrations, config)}.npz"
    try:
        return TrainedPointPolicy.load(path)
    except FileNotFoundError:
        pass
    except InvalidValueError as error:
        tqdm.write(f"note: {error.problem} Training it again.", file=sys.stderr)
    trained = train_point_policy(demonstrations, config)
    with whole_file(path) as file:
        trained.save(file)
    return trained


def training_key(demonstrations: Sequence[np.ndarray], config: PointPolicyConfig) -> str:
    """Returns what tells apart policies by their data and settings: 32 hexadecimal digits."""
    digest = hashlib.sha256()
    settings = {"version": TRAINING_VERSION, **asdict(config)}
    digest.update(json.dumps(settings, sort_keys=True).encode())
    for demonstration in demonstrations:
        values = np.ascontiguousarray(demonstration, dtype="<f8")
        digest.update(f"{values.shape}".encode())
        digest.update(values.tobytes())
    return digest.hexdigest()[:32]
