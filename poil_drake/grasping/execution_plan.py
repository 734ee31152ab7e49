"""Everything that execution needs, as one value and one file."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

import numpy as np

from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.errors import InvalidValueError
from poil_drake.geometry.frozen_array import SharedOnCopy, frozen_array
from poil_drake.grasping.candidates.grasp_candidate import GraspCandidate
from poil_drake.robots.joint_trajectory import JointTrajectory


@dataclass(frozen=True, eq=False, kw_only=True)
class ExecutionPlan(SharedOnCopy):
    """What transfer and grasp selection found, so that execution can run elsewhere and later.

    Attributes:
        object_label: The object's label.
        part_label: The functional part's label.
        target_points: (N, 3) the part's points at planning time [m, world].
        object_points: (P, 3) the object's surface at planning time [m, world], from which support
            points may be drawn.
        part_points: (M, 3) the functional part's surface at planning time [m, world].
        reference: The reference of the target points.
        grasp: The grasp.
        approach: Joint motion from where the robot stood to the pre-grasp.
        descent: Joint motion from there to the grasp.
        lift_height: How far to lift before the field takes over [m].
        retreat_distance: How far to back off after release [m].
        nominal_posture: (7,) posture with which the path was rehearsed [rad].
        metadata: Where the plan comes from: versions, seed, scenario, costs. Values are what JSON
            can hold.
    """

    object_label: str
    part_label: str
    target_points: np.ndarray
    object_points: np.ndarray
    part_points: np.ndarray
    reference: PointTrajectory
    grasp: GraspCandidate
    approach: JointTrajectory
    descent: JointTrajectory
    lift_height: float
    retreat_distance: float
    nominal_posture: np.ndarray
    metadata: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        count = self.reference.positions.shape[1]
        shapes: dict[str, tuple[int | str, ...]] = {
            "target_points": (count, 3),
            "object_points": ("P", 3),
            "part_points": ("M", 3),
            "nominal_posture": (7,),
        }
        for name, shape in shapes.items():
            array = frozen_array(getattr(self, name), name=f"ExecutionPlan.{name}", shape=shape)
            object.__setattr__(self, name, array)
        gap = np.abs(self.approach.positions[-1] - self.descent.positions[0]).max()
        if gap > 1e-6:
            raise InvalidValueError(
                f"ExecutionPlan.descent begins {gap} rad from where the approach ends.",
                remedy="Plan both to and from the same pre-grasp configuration.",
            )
        object.__setattr__(self, "metadata", MappingProxyType(dict(self.metadata)))

    @property
    def grasp_width(self) -> float:
        """Extent of what is grasped, along the closing axis [m]."""
        return self.grasp.width

    @property
    def pregrasp_width(self) -> float:
        """Finger opening while approaching and after releasing [m]."""
        return self.grasp.pregrasp_width

    def save(self, path: Path | str) -> None:
        """Writes the plan to a file, whole or not at all; see `plan_file`.

        Args:
            path: Where to; by custom it ends in ".npz".
        """
        from poil_drake.grasping.plan_file import write_plan

        write_plan(self, Path(path))

    @classmethod
    def load(cls, path: Path | str) -> "ExecutionPlan":
        """Reads a plan that `save` wrote.

        Args:
            path: The file.

        Raises:
            PlanFileError: The file is missing, damaged, incomplete or of another version.
        """
        from poil_drake.grasping.plan_file import read_plan

        return read_plan(Path(path))
