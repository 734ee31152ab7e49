"""Checks whether planned motions stay inside the boxes of the arm's workspace."""

import numpy as np

from poil_drake.errors import PlanningError
from poil_drake.grasping.rehearsal.feasibility import FeasibilityConfig
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.robots.posture_guard import PostureGuard

_SLACK = 0.002
"""Motions to a rehearsed grasp may fall short of the margin by this much [m]. Their samples, and
therefore their postures, differ slightly from the rehearsed ones."""

_SAG = 0.001
"""The arm may start this far outside its boxes [m], because a stop at a face may leave it there."""

_ROUNDING = 1e-9


class WorkspaceCheck:
    """Checks that motions to a grasp keep a margin to the faces of the workspace boxes.

    If the arm starts closer to a face than the margin, its distance from this face must not shrink.
    An arm without boxes passes every check.
    """

    def __init__(self, *, model: PandaModel, q_start: np.ndarray, feasibility: FeasibilityConfig):
        """Prepares the check.

        Args:
            model: The arm.
            q_start: (7,) the arm's present configuration [rad].
            feasibility: The boxes and the margin.

        Raises:
            PlanningError: The arm is outside its boxes.
        """
        self._guard = None
        if feasibility.posture is None:
            return
        self._guard = PostureGuard(model=model, config=feasibility.posture)
        start = self._guard.face_distances(q_start[None])[0]
        if start.min() < -_SAG:
            raise PlanningError(
                "The arm is outside its workspace box: "
                f"{self._guard.tightest_face(q_start[None])}.",
                remedy="Move the arm into the box, or widen the box (poil.safety.posture).",
            )
        self._least = np.minimum(feasibility.workspace_margin - _SLACK, start) - _ROUNDING

    def is_within(self, q: np.ndarray) -> np.ndarray:
        """Returns which configurations (B, 7) [rad] keep the margin: (B,) bool."""
        if self._guard is None:
            return np.ones(len(q), dtype=bool)
        return (self._guard.face_distances(q) >= self._least).all(axis=1)

    def require(self, q: np.ndarray, what: str) -> None:
        """Raises an error if a motion does not keep the margin.

        Args:
            q: (B, 7) the motion's configurations [rad], B >= 1.
            what: The motion's name, with which the error message begins.

        Raises:
            PlanningError: The motion does not keep the margin; the message names the face.
        """
        within = self.is_within(q)
        if self._guard is not None and not within.all():
            raise PlanningError(
                f"{what} comes too close to a face of the workspace box: "
                f"{self._guard.tightest_face(q[~within])}.",
                remedy="Widen the box (poil.safety.posture), or move the object away from that "
                "face.",
            )
