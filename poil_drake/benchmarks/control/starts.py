"""Start poses for the trials of the control study."""

import zlib
from typing import Literal

import numpy as np
from pydrake.systems.framework import Context
from scipy.spatial.transform import Rotation

from poil_drake.benchmarks.control.arena.arena import Arena
from poil_drake.benchmarks.control.arena.tasks import NEAR_HALF, ControlTask
from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_transform import make_transform

Region = Literal["near", "far", "hard"]

CLEARANCE = 0.01
"""Smallest distance at the start between the object and any fixture but the table [m]."""

_ABOVE_TABLE = 0.002  # [m]
_HARD_HEIGHTS = (0.12, 0.35)  # Heights of the object's frame above the table [m].
_ATTEMPTS = 1000


def trial_generator(task: str, region: str, trial: int, *, seed: int = 0) -> np.random.Generator:
    """Returns the generator of all random numbers of a trial, seeded by all four arguments."""
    return np.random.default_rng([zlib.crc32(f"{task} {region}".encode()), trial, seed])


def sample_start(
    arena: Arena, context: Context, shape: np.ndarray, region: Region, rng: np.random.Generator
) -> np.ndarray:
    """Returns a pose (4, 4) of the object in which it touches nothing.

    For "near", x and y come from a box around the demonstration's start; for "far", from a larger
    box without the Near box. The yaw is random in both (POIL, section IV-B). For "hard", x and y
    come from the whole larger box, and the height and the orientation are random.

    Args:
        arena: The arena to check for collisions.
        context: A context of the arena's diagram. The object is moved in it.
        shape: Positions of the object's joints, without its pose.
        region: The region to draw from.
        rng: The generator to draw with.

    Raises:
        InvalidValueError: if no collision-free start is found in the region.
    """
    for _ in range(_ATTEMPTS):
        X_WO = _draw(arena.task, region, rng)
        arena.place(context, X_WO, shape)
        distances = arena.clearance(context, 2.0 * CLEARANCE)
        if distances.pop("table", 1.0) > _ABOVE_TABLE and min(distances.values(), default=1.0) > (
            CLEARANCE
        ):
            return X_WO
    raise InvalidValueError(
        f"All {_ATTEMPTS} random {region} starts of {arena.task.title} are too close to a fixture.",
        remedy="Move the task's fixtures away from its start.",
    )


def _draw(task: ControlTask, region: Region, rng: np.random.Generator) -> np.ndarray:
    near = np.array(NEAR_HALF)
    lower, upper = (-near, near) if region == "near" else (task.far_lower, task.far_upper)
    offset = rng.uniform(lower, upper)
    while region == "far" and np.all(np.abs(offset) <= near):
        offset = rng.uniform(lower, upper)
    position = task.start[:3, 3] + np.array([*offset, 0.0])
    if region == "hard":
        position[2] = rng.uniform(*_HARD_HEIGHTS)
        return make_transform(Rotation.random(rng=rng).as_matrix(), position)
    yaw = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)).as_matrix()
    return make_transform(yaw @ task.start[:3, :3], position)


def distance_to_near(task: ControlTask, position: np.ndarray) -> float:
    """Returns the distance of a position (3,) from the Near box, in x and y [m]."""
    outside = np.abs(position[:2] - task.start[:2, 3]) - NEAR_HALF
    return float(np.linalg.norm(np.maximum(outside, 0.0)))
