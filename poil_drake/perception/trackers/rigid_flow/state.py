"""What the rigid-flow tracker carries from frame to frame."""

from dataclasses import dataclass

import numpy as np

from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.perception.trackers.rigid_flow.alignment.pose_alignment import PoseEstimate
from poil_drake.perception.trackers.rigid_flow.model_growth import Keyframe
from poil_drake.perception.trackers.rigid_flow.object_model import ObjectModel


@dataclass(frozen=True, eq=False)
class RigidFlowState(SharedOnCopy):
    """The tracker's knowledge after one frame, from which the next step starts.

    Attributes:
        model: The model of the object.
        keyframes: The views from which the model was learnt.
        pose: The object's pose; while it is lost, its predicted pose.
        velocity: (6,) velocity (ω [rad/s], v [m/s]) of the object in its own frame.
        stamp: Time of capture of the last frame [s].
        innovation: Difference (angle [rad], distance [m]) between the last pose and the pose that
            the motion prior predicted or, without a motion prior, the extrapolation.
        lost_since: Time of capture of the frame in which the object was lost [s]; None while it is
            tracked.
        candidate: (4, 4) the most likely pose of a lost object; None if no pose is likely.
        unconfirmed: Whether a lost object was found in the last frame, but far from where it was
            expected, so that the next frame has to confirm it.
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
