"""Whether planned motions keep to the boxes that the arm may be in."""

from typing import Self

import numpy as np

from poil_drake.errors import PlanningError
from poil_drake.grasping.rehearsal.feasibility import FeasibilityConfig
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.robots.posture_guard import PostureGuard

_SLACK = 0.002
"""So much less than the margin is enough for a motion to a rehearsed grasp [m]: it is followed in
other steps than in the rehearsal, and so comes to postures that are not quite the same."""

_SAG = 0.001
"""So far outside the arm may stand [m]: where a box has stopped it."""

_ROUNDING = 1e-9


class WorkspaceCheck:
    """Keeps motions from where the arm stands to a grasp within the boxes, by a margin.

    From a face that the arm stands nearer to, it need be no farther away than it is.
    """

    def __init__(self, *, guard: PostureGuard, margin: float, q_start: np.ndarray):
        """Prepares the check.

        Args:
            guard: What knows the boxes.
            margin: Distance from their faces [m].
            q_start: (7,) where the arm stands [rad].

        Raises:
            PlanningError: when that is outside.
        """
        self._guard = guard
        start = guard.face_distances(q_start[None])[0]
        if start.min() < -_SAG:
            raise PlanningError(
                "The arm stands outside the box that it may be in: "
                f"{guard.tightest_face(q_start[None])}.",
                remedy="Move it inside, or widen the box (poil.safety.posture).",
            )
        self._least = np.minimum(margin - _SLACK, start) - _ROUNDING

    @classmethod
    def of(
        cls, model: PandaModel, q_start: np.ndarray, feasibility: FeasibilityConfig
    ) -> Self | None:
        """Returns the check for an arm that stands somewhere; None where there are no boxes.

        Args:
            model: The arm.
            q_start: (7,) where it stands [rad].
            feasibility: The boxes and the margin.

        Raises:
            PlanningError: when it stands outside.
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
            q: (B, 7) its configurations [rad], one at least.
            what: What it is, at the beginning of a sentence.

        Raises:
            PlanningError: when it does not keep the margin, naming the face.
        """
        within = self.is_within(q)
        if not within.all():
            raise PlanningError(
                f"{what} comes too near to a face of the box that the arm may be in: "
                f"{self._guard.tightest_face(q[~within])}.",
                remedy="Widen the box (poil.safety.posture), move the object away from that face, "
                "or lower FeasibilityConfig.workspace_margin.",
            )
