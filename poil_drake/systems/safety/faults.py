"""The faults that stop the arm, and the thresholds for them."""

from dataclasses import dataclass, field

import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.robots.posture_guard import PostureGuardConfig, PostureRule
from poil_drake.robots.velocity_limiter import VelocityLimiterConfig
from poil_drake.systems.statuses import DescribedEnum


class SafetyFault(DescribedEnum):
    """Why `SafetySupervisor` stopped the arm, with a clause for reports."""

    NONE = 0, "no fault"
    STOP_REQUESTED = 1, "a stop was requested"
    NO_STATUS = 2, "the robot's status stopped coming, came late, or held no position"
    CLOCK_OFF = 3, "the clocks of this machine and of the robot's driver differ"
    ROBOT_MODE = 4, "the robot left its moving mode"
    SUCCESS_RATE = 5, "too few commands reached the robot in time"
    COMMAND_STALE = 6, "the controller stopped computing velocities"
    COMMAND_NOT_FINITE = 7, "the controller commanded a velocity that is not finite"
    WORKSPACE = 8, "the arm was about to leave its workspace"
    TABLE = 9, "the arm was about to touch the table"
    SELF_COLLISION = 10, "the arm was about to touch itself"
    EXTERNAL_TORQUE = 11, "something pushed the arm too hard"
    TRACKING_ERROR = 12, "the robot is not where it was commanded to be"
    CAMERA_STALE = 13, "a camera stopped delivering images"
    CAMERA_CLOCK = 14, "a camera's images are stamped in the future"
    LOOP_STALLED = 15, "this process was held up, so that the arm was left without commands"


POSTURE_FAULTS = {rule: SafetyFault[rule.name] for rule in PostureRule}
"""For each rule, the fault that stops an arm that is about to break this rule."""


@dataclass(frozen=True, kw_only=True)
class SafetyConfig:
    """Thresholds of the faults, and limits of the arm's motion.

    Attributes:
        limiter: Shares of the joints' limits that the arm may use. The default acceleration share
            exceeds that of `DifferentialInverseKinematicsConfig`, whose commands pass unchanged.
            The default jerk share delays a velocity by at most 4 ms. The option `--speed`
            multiplies `velocity_scale`.
        posture: The workspace that the arm must stay in.
        status_age_limit: Largest difference between the clock and the stamp of the robot's status
            [s]: a dozen control periods.
        clock_off_age: Statuses that keep arriving but are older than this [s] indicate a clock
            that is off, not a slow network.
        min_success_rate: Smallest share of commands that must reach the robot in time; Franka's
            communication test rejects a network with less.
        success_rate_time: How long the share may stay below `min_success_rate` [s]. At first the
            share is low, because the robot computes it over its last 0.1 s.
        command_age_limit: Largest age of the desired velocity [s]: a dozen control periods.
        external_torque: Largest external torque on each joint [N m], as in the motion examples
            of Franka's library. Grasping and hanging a mug takes up to 7 N m.
        external_torque_time: How long a torque may exceed its limit [s]: longer than a single bad
            measurement, shorter than a person's reaction.
        tracking_leash: Largest difference between a joint's commanded and its measured position
            [rad]. At 1 rad/s the status may lag by 0.05 rad, and the driver may hold back an arm in
            contact by another 0.05 rad.
        rest_speed: An arm with all measured joint speeds below this is at rest [rad/s].
        image_age_limit: Largest age of a camera's newest image [s]: more than trackers can bridge.
        image_ahead_limit: How far the stamp of an image may be in the future [s].
        stall_limit: Longest time between two updates by the supervisor's clock [s]: shorter than
            the time for which the driver follows a command. Without a clock it has no effect.
    """

    limiter: VelocityLimiterConfig = field(
        default_factory=lambda: VelocityLimiterConfig(acceleration_scale=0.9, jerk_scale=0.5)
    )
    posture: PostureGuardConfig = field(default_factory=PostureGuardConfig)
    status_age_limit: float = 0.05
    clock_off_age: float = 0.5
    min_success_rate: float = 0.9
    success_rate_time: float = 0.5
    command_age_limit: float = 0.05
    external_torque: tuple[float, ...] = (20.0, 20.0, 18.0, 18.0, 16.0, 14.0, 12.0)
    external_torque_time: float = 0.03
    tracking_leash: float = 0.1
    rest_speed: float = 0.05
    image_age_limit: float = 1.0
    image_ahead_limit: float = 0.05
    stall_limit: float = 0.08

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name in ("limiter", "posture", "min_success_rate"):
                continue
            numbers = np.ravel(value)
            if not numbers.size or not ((numbers > 0.0) & (numbers < np.inf)).all():
                raise InvalidValueError(
                    f"SafetyConfig.{name} is {value}.", remedy="It must be positive and finite."
                )
        if not 0.0 <= self.min_success_rate <= 1.0:
            raise InvalidValueError(
                f"SafetyConfig.min_success_rate is {self.min_success_rate}.",
                remedy="It must be in [0, 1].",
            )
