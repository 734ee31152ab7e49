"""Whether planned motions stay inside the boxes of the arm's workspace."""

from typing import Self

import numpy as np

from poil_drake.errors import PlanningError
from poil_drake.grasping.rehearsal.feasibility import FeasibilityConfig
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.robots.posture_guard import PostureGuard

_SLACK = 0.002
"""Motions to a rehearsed grasp may come this much closer than the margin [m]: their samples differ
from those of the rehearsal, so their postures differ slightly, too."""

_SAG = 0.001
"""The arm may start this far outside its boxes [m], as it may after a stop at one of the faces."""

_ROUNDING = 1e-9


class WorkspaceCheck:
    """Checks that motions to a grasp keep a margin to the faces of the boxes.

    A motion that starts closer to a face than the margin only must not come any closer.
    """

    def __init__(self, *, guard: PostureGuard, margin: float, q_start: np.ndarray):
        """Prepares the check.

        Args:
            guard: The boxes.
            margin: Required distance from their faces [m].
            q_start: (7,) the arm's present configuration [rad].

        Raises:
            PlanningError: The arm is outside its boxes.
        """
        self._guard = guard
        start = guard.face_distances(q_start[None])[0]
        if start.min() < -_SAG:
            raise PlanningError(
                f"The arm is outside its workspace box: {guard.tightest_face(q_start[None])}.",
                remedy="Move the arm inside, or widen the box (poil.safety.posture).",
            )
        self._least = np.minimum(margin - _SLACK, start) - _ROUNDING

    @classmethod
    def of(
        cls, model: PandaModel, q_start: np.ndarray, feasibility: FeasibilityConfig
    ) -> Self | None:
        """Returns the check for motions from `q_start` (7,) [rad]; None where there are no boxes.

        Raises:
            PlanningError: The arm is outside its boxes.
        """
        if feasibility.posture is None:
            return None
        guard = PostureGuard(model=model, config=feasibility.posture)
        return cls(guard=guard, margin=feasibility.workspace_margin, q_start=q_start)

    def is_within(self, q: np.ndarray) -> np.ndarray:
        """Returns whether each configuration (B, 7) [rad] keeps the margin: (B,) bool."""
        return (self._guard.face_distances(q) >= self._least).all(axis=1)

    def require(self, q: np.ndarray, what: str) -> None:
        """Checks a motion.

        Args:
            q: (B, 7) its configurations [rad], B >= 1.
            what: The motion's name, which begins a sentence.

        Raises:
            PlanningError: The motion does not keep the margin; the message names the face.
        """
        within = self.is_within(q)
        if not within.all():
            raise PlanningError(
                f"{what} comes too close to a face of the workspace box: "
                f"{self._guard.tightest_face(q[~within])}.",
                remedy="Widen the box (poil.safety.posture), or move the object away from that "
                "face.",
            )
