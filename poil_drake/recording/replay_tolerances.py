"""Up to which differences a run and its replay count as the same."""

from dataclasses import dataclass, replace
from typing import Self

JOINT_VELOCITY = "joint_velocity_rad_s"
ANGULAR_VELOCITY = "angular_velocity_rad_s"
LINEAR_VELOCITY = "linear_velocity_m_s"
TRACKED_POINTS = "tracked_points_m"


_CORRECTIONS = 0.25
"""The part of the tolerances that is for corrections: at a fifth of the usual speed two replays of
whole runs differed by 0.073 rad/s, at the usual one by 0.054 to 0.13 rad/s."""


@dataclass(frozen=True, kw_only=True)
class ReplayTolerances:
    """Up to which differences two runs count as the same.

    Attributes:
        joint_velocity: Of each joint's commanded velocity [rad/s].
        angular_velocity: Of the gripper's angular velocity asked for [rad/s].
        linear_velocity: Of its linear velocity asked for [m/s].
        tracked_points: Of each tracked point [m], in the phases in which they move the arm.
        phase_start: Of the time at which a phase begins [s].
        unmatched_tracks: Share of the tracks, in the phases in which they move the arm, that only
            one of the two has, or that show no point that both saw.
        point_phases: The phases in which the points move the arm. In others nothing depends on
            them, and a hand that lets go hides them.
        elsewhere: What holds for the velocities in all other phases, if they began at the same
            time in both; None: the same.
    """

    joint_velocity: float
    angular_velocity: float
    linear_velocity: float
    tracked_points: float
    phase_start: float
    unmatched_tracks: float = 0.05
    point_phases: tuple[str, ...] = ("follow",)
    elsewhere: "ReplayTolerances | None" = None

    def of(self, signal: str) -> float:
        """Returns the tolerance of a signal, where points move the arm."""
        return {
            JOINT_VELOCITY: self.joint_velocity,
            ANGULAR_VELOCITY: self.angular_velocity,
            LINEAR_VELOCITY: self.linear_velocity,
            TRACKED_POINTS: self.tracked_points,
        }[signal]

    def at_speed(self, speed: float) -> Self:
        """Returns the tolerances of a run at a share of the usual speed, in (0, 1].

        The motion is slower by that share, and so is what another time at which a point is seen
        makes of it; what corrects an error of the points is as fast as ever.
        """
        share = _CORRECTIONS + (1.0 - _CORRECTIONS) * speed
        return replace(
            self,
            joint_velocity=share * self.joint_velocity,
            angular_velocity=share * self.angular_velocity,
            linear_velocity=share * self.linear_velocity,
        )


CONTROL_TOLERANCES = ReplayTolerances(
    joint_velocity=1e-3,
    angular_velocity=1e-3,
    linear_velocity=1e-4,
    tracked_points=1e-6,
    phase_start=1e-3,
    unmatched_tracks=0.0,
)
"""Where the tracks are repeated, all inputs are the same to the last bit; what is tolerated is
that another processor rounds otherwise, and not another decision."""

PERCEPTION_TOLERANCES = ReplayTolerances(
    joint_velocity=0.25,
    angular_velocity=0.2,
    linear_velocity=0.05,
    tracked_points=0.006,
    phase_start=0.25,
    elsewhere=CONTROL_TOLERANCES,
)
"""Where images are tracked again, they are not quite those that were tracked: colours are
compressed, depth is rounded to millimetres. Several times what that makes in the usual run, at the
usual speed; where points move nothing, all inputs are the same."""
