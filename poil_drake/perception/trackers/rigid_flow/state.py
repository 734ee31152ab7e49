"""What the rigid-flow tracker carries from frame to frame."""

from dataclasses import dataclass

import numpy as np

from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.perception.trackers.rigid_flow.alignment.pose_alignment import PoseEstimate
from poil_drake.perception.trackers.rigid_flow.model_growth import Keyframe
from poil_drake.perception.trackers.rigid_flow.object_model import ObjectModel


@dataclass(frozen=True, eq=False)
class RigidFlowState(SharedOnCopy):
    """What one step hands to the next.

    Attributes:
        model: The object.
        keyframes: The views from which the model was learnt.
        pose: The object's pose; while it is lost, its predicted pose.
        velocity: (6,) of the object in its own frame [rad/s, m/s].
        stamp: Time of capture of the last frame [s].
        innovation: (angular [rad], linear [m]) difference between the last motion and the motion
            prior or, without one, the prediction.
        lost_since: Time of capture of the frame in which the object was lost [s]; None while it is
            tracked.
        candidate: (4, 4) the most likely pose of a lost object; None if no pose is likely.
        unconfirmed: Whether the last frame found a lost object and the next one has to confirm it.
    """

    model: ObjectModel
    keyframes: tuple[Keyframe, ...]
    pose: PoseEstimate
    velocity: np.ndarray
    stamp: float
    innovation: tuple[float, float] = (0.0, 0.0)
    lost_since: float | None = None
    candidate: np.ndarray | None = None
    unconfirmed: bool = False
