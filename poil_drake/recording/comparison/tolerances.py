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
        joint_velocity: Of each joint's commanded velocity [rad/s].
        angular_velocity: Of the gripper's desired angular velocity [rad/s].
        linear_velocity: Of its desired linear velocity [m/s].
        tracked_points: Of each tracked point [m], in the phases in which points move the arm.
        phase_start: Of the time at which a phase begins [s].
        shift: How much earlier or later the velocities may be [s] while points move the arm, and
            for `phase_start` after: where a point is slightly off, the field's reference jumps when
            the arm is at a slightly different place. Oscillations faster than that are not
            distinguished.
        unmatched_tracks: Share of the tracks, in the phases in which points move the arm, that only
            one of the two has, or that show no point that both saw.
        point_phases: The phases in which the points move the arm. In others nothing depends on
            them, and a hand that lets go hides them.
        elsewhere: The tolerances of the velocities in all other phases, if they began at the same
            time in both; None: the same.
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
                f"ReplayTolerances.shift is {self.shift} s.",
                remedy="It must be finite, and not negative.",
            )

    def of(self, signal: str) -> float:
        """Returns the tolerance of a signal while points move the arm."""
        return {
            JOINT_VELOCITY: self.joint_velocity,
            ANGULAR_VELOCITY: self.angular_velocity,
            LINEAR_VELOCITY: self.linear_velocity,
            TRACKED_POINTS: self.tracked_points,
        }[signal]

    def at_speed(self, speed: float) -> Self:
        """Returns the tolerances of a run at a share of the usual speed, in (0, 1].

        Velocities are smaller by that factor, and the arm takes longer by it to reach a place;
        `shift` is `phase_start` at most.
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
"""For repeated tracks: all inputs are the same to the last bit. Another processor may round
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
"""For images that are tracked again: they differ slightly from those of the run, as colours are
compressed and depth is rounded to millimetres. The values are several times the effect of that in
the usual run at the usual speed. While points move nothing, all inputs are the same."""
