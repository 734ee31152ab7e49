"""The differences up to which a run and its replay count as the same."""

import math
from dataclasses import dataclass, replace
from typing import Self

from poil_drake.errors import InvalidValueError

JOINT_VELOCITY = "joint_velocity_rad_s"
ANGULAR_VELOCITY = "angular_velocity_rad_s"
LINEAR_VELOCITY = "linear_velocity_m_s"
TRACKED_POINTS = "tracked_points_m"


@dataclass(frozen=True, kw_only=True)
class ReplayTolerances:
    """The differences up to which two runs count as the same.

    Attributes:
        joint_velocity: Difference of each joint's commanded velocity [rad/s].
        angular_velocity: Difference of the gripper's commanded angular velocity [rad/s].
        linear_velocity: Difference of the gripper's commanded linear velocity [m/s].
        tracked_points: Distance between the positions of each tracked point in both runs [m], in
            the phases `point_phases`.
        phase_start: Difference of the times at which a phase begins [s].
        shift: Time by which the velocities may be earlier or later [s], in the phases
            `point_phases` and for `phase_start` after them. Small errors of points cause such
            shifts. Oscillations with a period below `shift` are not detected.
        unmatched_tracks: Share of the tracks in the phases `point_phases` that cannot be compared,
            because only one run has the track, or because the runs saw no point in common.
        point_phases: The phases in which the points move the arm. In other phases, nothing depends
            on the points, and the opening hand may hide them.
        elsewhere: The tolerances of the velocities in phases that are not in `point_phases`, if
            they began at the same time in both runs. If None, the attributes above always apply.
    """

    joint_velocity: float
    angular_velocity: float
    linear_velocity: float
    tracked_points: float
    phase_start: float
    shift: float = 0.0
    unmatched_tracks: float = 0.05
    point_phases: tuple[str, ...] = ("follow",)
    elsewhere: "ReplayTolerances | None" = None

    def __post_init__(self) -> None:
        if not 0.0 <= self.shift < math.inf:
            raise InvalidValueError(
                f"ReplayTolerances.shift is {self.shift} s, but must be finite and not negative.",
                remedy="Set it to 0 or to a short time.",
            )

    def of(self, signal: str) -> float:
        """Returns the tolerance of a signal, e.g. `JOINT_VELOCITY`, while points move the arm."""
        return {
            JOINT_VELOCITY: self.joint_velocity,
            ANGULAR_VELOCITY: self.angular_velocity,
            LINEAR_VELOCITY: self.linear_velocity,
            TRACKED_POINTS: self.tracked_points,
        }[signal]

    def at_speed(self, speed: float) -> Self:
        """Returns the tolerances for a run at `speed`, in (0, 1], times the usual speed.

        Multiplies the tolerances of velocities by `speed`. Divides `shift` by `speed`, but limits
        it to `phase_start`.
        """
        return replace(
            self,
            joint_velocity=speed * self.joint_velocity,
            angular_velocity=speed * self.angular_velocity,
            linear_velocity=speed * self.linear_velocity,
            shift=min(self.shift / speed, self.phase_start),
        )


CONTROL_TOLERANCES = ReplayTolerances(
    joint_velocity=1e-3,
    angular_velocity=1e-3,
    linear_velocity=1e-4,
    tracked_points=1e-6,
    phase_start=1e-3,
    unmatched_tracks=0.0,
)
"""For a replay of recorded tracks, in which all inputs are identical. Another processor may round
differently, but no decision may differ."""

PERCEPTION_TOLERANCES = ReplayTolerances(
    joint_velocity=0.25,
    angular_velocity=0.2,
    linear_velocity=0.05,
    tracked_points=0.006,
    phase_start=0.25,
    shift=0.01,
    elsewhere=CONTROL_TOLERANCES,
)
"""For a replay that tracks the logged images again. The logged images differ slightly from those of
the run, because colours are compressed and depth is rounded to millimetres. Each tolerance is
several times the effect of these differences in a typical run at the usual speed. While no points
move the arm, all inputs are identical."""
