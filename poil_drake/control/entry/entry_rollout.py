"""Where the field would carry the object from here, checked for collisions on the way."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from poil_drake.control.entry.entry_clearance import EntryStart
from poil_drake.control.entry.entry_model import EntryModel
from poil_drake.control.field.bcsdm_config import BcsdmConfig
from poil_drake.control.field.point_set_bcsdm import BcsdmStatus, point_set_bcsdm
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.geometry.rigid_fit import kabsch
from poil_drake.geometry.rigid_transform import moved_by_twist, transform_points


@dataclass(frozen=True, kw_only=True)
class EntryRolloutConfig:
    """How the field is followed ahead.

    The field depends on the place alone, so that a speed limit which keeps its direction does not
    change the way; steps may be as long as the way is straight.

    Attributes:
        step_length: Farthest that a point of the object moves in a step [m].
        step_time: Longest step [s]; with eta = 3 / s it takes off a third of the error.
        contact_tube: From the first contact on, the reference may only be the field's target while
            no point of the object is farther from it than this [m]. Where the demonstration touches
            the scene, clouds cannot tell whether a loop is around a rod or below it, and of a strap
            that the rod has bent even less; only the way there can.
        joined: Once no point of the object is farther from the reference than this [m], the rest
            of the way is the reference.
        max_steps: A field that has not joined the reference by then, such as close to a saddle,
            does not count as clear. 2 m of way, and the time to converge.
        batch: Steps between two checks.
    """

    step_length: float = 0.01
    step_time: float = 0.1
    contact_tube: float = 0.04
    joined: float = 0.002
    max_steps: int = 300
    batch: int = 12


class EntryRollout(NamedTuple):
    """What is ahead.

    Attributes:
        poses: (K, 4, 4) X_WB up to where the reference was joined.
        clear: Whether it was joined, and the clearance demanded was kept all the way there.
    """

    poses: np.ndarray
    clear: bool


def roll_out_entry(
    model: EntryModel,
    start: EntryStart,
    reference: PointTrajectory,
    field: BcsdmConfig,
    config: EntryRolloutConfig,
    *,
    tau: float | None = None,
) -> EntryRollout:
    """Follows the field from a pose until it has joined the reference, or collides, or cuts short.

    Args:
        model: Object and scene.
        start: Where the object is.
        reference: What the field follows.
        field: Its parameters.
        config: Steps and checks.
        tau: Time of the closest configuration before, for the progress window [s].
    """
    X = start.X_WB
    poses: list[np.ndarray] = []
    checked = 0
    for _ in range(config.max_steps):
        poses.append(X)
        points = transform_points(X, model.points)
        output = point_set_bcsdm(points, reference, field, previous_tau=tau)
        if output.status is BcsdmStatus.LOST:
            break
        tau = output.tau
        X_target = kabsch(model.points, reference.positions_at(tau))
        apart = float(model.displacement(X[None], X_target[None])[0, 0])
        if model.is_contact(reference.times[-1] - tau) and apart > config.contact_tube:
            break
        joined = output.status is BcsdmStatus.GOAL or (
            output.mean_error < config.joined and apart < config.joined
        )
        if joined or len(poses) - checked >= config.batch:
            if not model.is_free(np.array(poses[checked:]), start).all():
                break
            checked = len(poses)
        if joined:
            return EntryRollout(np.array(poses), True)
        X = _step(X, output.omega, output.v, output.centroid, model.radius, config)
    return EntryRollout(np.array(poses), False)


def _step(
    X: np.ndarray,
    omega: np.ndarray,
    v: np.ndarray,
    centroid: np.ndarray,
    radius: float,
    config: EntryRolloutConfig,
) -> np.ndarray:
    """Returns X after a step: a turn about the points' centroid, which moves straight."""
    arm = X[:3, 3] - centroid
    speed = float(np.linalg.norm(v + np.cross(omega, arm)) + radius * np.linalg.norm(omega))
    time = min(config.step_time, config.step_length / max(speed, 1e-9))
    return moved_by_twist(X, np.concatenate([omega, v]), centroid, time)
