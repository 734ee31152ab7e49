"""Rolls the field out from the object's pose and checks the path for collisions."""

from typing import NamedTuple

import numpy as np

from poil_drake.control.entry.entry_clearance import EntryStart
from poil_drake.control.entry.entry_model import EntryModel
from poil_drake.control.field.point_set_bcsdm import (
    BcsdmConfig,
    BcsdmOutput,
    BcsdmStatus,
    point_set_bcsdm,
)
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.geometry.rigid_fit import kabsch
from poil_drake.geometry.rigid_transform import moved_by_twist, transform_points

# The field depends on the pose alone, so a speed limit that keeps the field's direction does not
# change the path, and steps may be long where the path is nearly straight.
_STEP_LENGTH = 0.01
"""Largest motion of a point of the object in a step [m]."""

_STEP_TIME = 0.1
"""Longest step [s]; with eta = 3 / s it removes a third of the error."""

_CONTACT_TUBE = 0.04
"""Where the reference is in contact, a rollout is clear only if no point of the object is farther
from the reference than this [m]. Clouds in contact do not show whether a loop is around a rod or
below it, or whether the rod bends a strap; only the path does."""

_JOINED = 0.002
"""The object has joined the reference once none of its points is farther from it than this [m]."""

_MAX_STEPS = 300
"""Enough for 2 m of path and the time to converge. A field that has not joined the reference by
then, for example close to a saddle, does not count as clear."""

_BATCH = 12
"""Number of steps between two checks for collisions."""


class EntryRollout(NamedTuple):
    """The path of the object under the field.

    Attributes:
        poses: (K, 4, 4) X_WB from the start until the object joins the reference, or the rollout
            stops.
        clear: Whether the object joins the reference, and keeps the required clearance until then.
    """

    poses: np.ndarray
    clear: bool


def roll_out_entry(
    model: EntryModel,
    start: EntryStart,
    reference: PointTrajectory,
    field: BcsdmConfig,
    *,
    tau: float | None = None,
) -> EntryRollout:
    """Returns the object's path under the field until it joins the reference.

    The rollout stops earlier if the object collides, or if it leaves a part of the reference that
    is in contact with the scene.

    Args:
        model: Object and scene.
        start: Pose of the object.
        reference: The reference that the field follows.
        field: Parameters of the field.
        tau: Time of the last closest configuration, for the progress window [s].
    """
    X = start.X_WB
    poses: list[np.ndarray] = []
    checked = 0
    for _ in range(_MAX_STEPS):
        poses.append(X)
        points = transform_points(X, model.points)
        output = point_set_bcsdm(points, reference, field, previous_tau=tau)
        if output.status is BcsdmStatus.LOST:
            break
        tau = output.tau
        X_target = kabsch(model.points, output.target_points)
        apart = float(model.displacement(X[None], X_target[None])[0, 0])
        if reference.times[-1] - tau <= model.contact_left and apart > _CONTACT_TUBE:
            break
        joined = output.status is BcsdmStatus.GOAL or max(output.mean_error, apart) < _JOINED
        if joined or len(poses) - checked >= _BATCH:
            if not model.is_free(np.array(poses[checked:]), start).all():
                break
            checked = len(poses)
        if joined:
            return EntryRollout(np.array(poses), True)
        X = _step(X, output, model.radius)
    return EntryRollout(np.array(poses), False)


def _step(X: np.ndarray, output: BcsdmOutput, radius: float) -> np.ndarray:
    """Returns the next pose: the body turns about the centroid, and the centroid moves straight."""
    omega, arm = output.omega, X[:3, 3] - output.centroid
    speed = float(np.linalg.norm(output.v + np.cross(omega, arm)) + radius * np.linalg.norm(omega))
    duration = min(_STEP_TIME, _STEP_LENGTH / max(speed, 1e-9))
    return moved_by_twist(X, output.twist, output.centroid, duration)
