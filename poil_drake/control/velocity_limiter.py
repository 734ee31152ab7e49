"""Joint velocities that an arm can follow, and stop from, within all of its limits."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from ruckig import ControlInterface, InputParameter, Result, Ruckig, Synchronization, Trajectory

from poil_drake.control.joint_limits import JointLimits
from poil_drake.errors import InvalidValueError
from poil_drake.geometry.frozen_array import frozen_array

_SHARES = (1.0, 0.5, 0.25, 0.125)
"""Parts of the wanted velocity that are tried, the largest first, before the arm brakes."""


class JointMotion(NamedTuple):
    """What the joints are commanded to do at one instant.

    Attributes:
        position: (n,) [rad].
        velocity: (n,) [rad/s].
        acceleration: (n,) [rad/s^2].
    """

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray

    @classmethod
    def at_rest(cls, position: np.ndarray) -> "JointMotion":
        """Returns standing still at a position (n,) [rad]."""
        return cls(position, np.zeros(position.size), np.zeros(position.size))


@dataclass(frozen=True, kw_only=True)
class VelocityLimiterConfig:
    """How much of its limits the arm may use.

    Attributes:
        jerk: Largest jerk of each joint [rad/s^3]; the Panda's, from Franka's documentation.
        velocity_scale: Share of the speed limits.
        acceleration_scale: Share of the acceleration limits.
        jerk_scale: Share of the jerk limits.
        position_margin: Distance that is kept from the position limits [rad].
    """

    jerk: tuple[float, ...] = (7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0)
    velocity_scale: float = 1.0
    acceleration_scale: float = 0.5
    jerk_scale: float = 0.1
    position_margin: float = 0.05

    def __post_init__(self) -> None:
        for name in ("velocity_scale", "acceleration_scale", "jerk_scale"):
            if not 0.0 < getattr(self, name) <= 1.0:
                raise InvalidValueError(
                    f"VelocityLimiterConfig.{name} is {getattr(self, name)}.",
                    remedy="It must be above 0, and 1 at most.",
                )
        if not self.position_margin >= 0.0 or not all(j > 0.0 for j in self.jerk):
            raise InvalidValueError(
                f"VelocityLimiterConfig has position_margin={self.position_margin} rad and "
                f"jerk={self.jerk} rad/s^3.",
                remedy="The margin must not be negative, and the jerks positive.",
            )


class VelocityLimiter:
    """Keeps joint velocities within limits of position, speed, acceleration and jerk.

    By Ruckig (Berscheid and Kroeger 2021), which finds the fastest motion to a wanted velocity.
    All joints share one scale, so that the direction is kept where it can be. Every step leaves the
    arm able to brake within the position limits: the braking that follows a step is computed before
    the step is taken, and a smaller part of the velocity, or braking, is chosen where it would end
    outside. So, from a motion from which the arm can stop, all later ones have this property.

    It holds no state; what was commanded before is passed in.
    """

    def __init__(
        self,
        *,
        limits: JointLimits,
        period: float,
        config: VelocityLimiterConfig | None = None,
    ):
        """Constructs the limiter.

        Args:
            limits: Of the joints.
            period: Time between two commands [s].
            config: How much of the limits may be used.

        Raises:
            InvalidValueError: if there is not one jerk for each joint.
        """
        config = config or VelocityLimiterConfig()
        n = limits.lower.size
        jerk = frozen_array(np.array(config.jerk), name="VelocityLimiterConfig.jerk", shape=(n,))
        self._period = period
        self._lower = limits.lower + config.position_margin
        self._upper = limits.upper - config.position_margin
        self._speed = config.velocity_scale * limits.velocity
        self._ruckig, self._input = Ruckig(n), InputParameter(n)
        self._input.control_interface = ControlInterface.Velocity
        self._input.synchronization = Synchronization.Phase
        self._input.max_acceleration = (config.acceleration_scale * limits.acceleration).tolist()
        self._input.max_jerk = (config.jerk_scale * jerk).tolist()
        self._input.target_acceleration = [0.0] * n

    def step(self, motion: JointMotion, wanted: np.ndarray) -> JointMotion:
        """Returns the motion one period later.

        Args:
            motion: What is commanded now.
            wanted: (n,) velocity [rad/s]; where it is not finite, rest is wanted.
        """
        if not np.isfinite(wanted).all():
            wanted = np.zeros_like(motion.velocity)
        share = float(np.max(np.abs(wanted) / self._speed, initial=1.0))
        wanted = wanted / share
        if wanted.any():
            for share in _SHARES:
                after = self._towards(motion, share * wanted)
                if self._can_stop(after, motion.position):
                    return after
        return self._towards(motion, np.zeros_like(wanted))

    def _towards(self, motion: JointMotion, velocity: np.ndarray) -> JointMotion:
        trajectory = self._plan(motion, velocity)
        return JointMotion(*(np.array(one) for one in trajectory.at_time(self._period)))

    def _can_stop(self, motion: JointMotion, before: np.ndarray) -> bool:
        """Returns whether braking from a motion ends within the limits, or no farther outside."""
        rest = np.zeros_like(motion.velocity)
        # Ruckig's extrema of a motion to a velocity always have zero among them: the start, here.
        braking = self._plan(motion._replace(position=rest), rest)
        extrema = np.array([(one.min, one.max) for one in braking.position_extrema])
        lowest, highest = motion.position + extrema.T
        return bool(
            np.all(lowest >= np.minimum(self._lower, before))
            and np.all(highest <= np.maximum(self._upper, before))
        )

    def _plan(self, motion: JointMotion, velocity: np.ndarray) -> Trajectory:
        self._input.current_position = motion.position.tolist()
        self._input.current_velocity = motion.velocity.tolist()
        self._input.current_acceleration = motion.acceleration.tolist()
        self._input.target_velocity = velocity.tolist()
        # A new one each time: one that held a motion of no length keeps its extrema.
        trajectory = Trajectory(velocity.size)
        result = self._ruckig.calculate(self._input, trajectory)
        if result not in (Result.Working, Result.Finished):
            raise InvalidValueError(
                f"No motion from {motion} to the velocity {velocity} was found ({result}).",
                remedy="Pass positions, velocities and accelerations within the limits.",
            )
        return trajectory
