"""What the rigid-flow tracker carries from frame to frame."""

from dataclasses import dataclass

import numpy as np

from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.perception.trackers.rigid_flow.alignment.pose_alignment import PoseEstimate
from poil_drake.perception.trackers.rigid_flow.model_growth import Keyframe, ReferenceView
from poil_drake.perception.trackers.rigid_flow.object_model import ObjectModel
from poil_drake.perception.trackers.rigid_flow.track_quality import Evidence


@dataclass(frozen=True, eq=False)
class RigidFlowState(SharedOnCopy):
    """What one step hands to the next.

    Attributes:
        model: The object.
        reference_views: What the first frame saw, for growth to compare with.
        keyframes: From where the model has been learnt.
        pose: Where the object is, or where it was last believed to be.
        velocity: (6,) of the object in its own frame [rad/s, m/s].
        stamp: Time of capture of the last frame [s].
        innovation: (angular [rad], linear [m]) how far the last motion was from what was expected
            of it, by the motion prior if there was one.
        lost_since: Time of capture of the frame in which the object was lost [s]; None while it is
            tracked.
        guess: (4, 4) where a lost object may be, from the last search; None without an idea.
        found: Whether the last search found a lost object, and the next has to confirm it.
        evidence: What the last views said about the pose; None at the start.
    """

    model: ObjectModel
    reference_views: tuple[ReferenceView, ...]
    keyframes: tuple[Keyframe, ...]
    pose: PoseEstimate
    velocity: np.ndarray
    stamp: float
    innovation: tuple[float, float]
    lost_since: float | None
    guess: np.ndarray | None
    found: bool
    evidence: Evidence | None
