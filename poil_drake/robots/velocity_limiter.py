"""Limits joint velocities so that an arm can follow them, and stop, within all of its limits."""

import weakref
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from ruckig import ControlInterface, InputParameter, Result, Ruckig, Synchronization, Trajectory

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.frozen_array import frozen_array
from poil_drake.robots.joint_limits import JointLimits
from poil_drake.robots.panda import JERK_LIMITS

Reason = TypeVar("Reason")

_SHARES = (1.0, 0.5, 0.25, 0.125)
"""Shares of the desired velocity to try, in this order, before the arm brakes."""


class JointMotion(NamedTuple):
    """Commanded motion of the joints at one instant.

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
        """Returns the motion at rest at a position (n,) [rad]."""
        return cls(position, np.zeros(position.size), np.zeros(position.size))


class GuardedStep(NamedTuple, Generic[Reason]):
    """A step of the limiter, and the share of the desired velocity that it heads for.

    Attributes:
        motion: The motion one period later.
        share: The share of the desired velocity that the arm heads for, in [0, 1]: 1 if no limit
            and no forbidden posture reduces it, 0 if the arm brakes instead.
        reason: What `refuse` of `guarded_step` returned for the largest share that it refused; None
            if it refused none.
    """

    motion: JointMotion
    share: float
    reason: Reason | None


@dataclass(frozen=True, kw_only=True)
class VelocityLimiterConfig:
    """Shares of the joints' limits that the arm may use.

    Attributes:
        jerk: Largest jerk of each joint [rad/s^3].
        velocity_scale: Share of the speed limits.
        acceleration_scale: Share of the acceleration limits.
        jerk_scale: Share of the jerk limits.
        position_margin: Distance to keep from the position limits [rad].
    """

    jerk: tuple[float, ...] = JERK_LIMITS
    velocity_scale: float = 1.0
    acceleration_scale: float = 0.5
    jerk_scale: float = 0.1
    position_margin: float = 0.05

    def __post_init__(self) -> None:
        for name in ("velocity_scale", "acceleration_scale", "jerk_scale"):
            if not 0.0 < getattr(self, name) <= 1.0:
                raise InvalidValueError(
                    f"VelocityLimiterConfig.{name} is {getattr(self, name)}.",
                    remedy="It must be above 0 and at most 1.",
                )
        if not self.position_margin >= 0.0:
            raise InvalidValueError(
                f"VelocityLimiterConfig.position_margin is {self.position_margin} rad.",
                remedy="It must not be negative.",
            )
        if not all(j > 0.0 for j in self.jerk):
            raise InvalidValueError(
                f"VelocityLimiterConfig.jerk is {self.jerk}.", remedy="Every jerk must be positive."
            )


class VelocityLimiter:
    """Keeps joint velocities within limits of position, speed, acceleration and jerk.

    Ruckig (Berscheid and Kroeger 2021) finds the fastest motion to a desired velocity. All joints
    share one scale, which keeps the direction where possible. After every step the arm can brake
    within the position limits: the limiter also plans the braking that would follow the step. If
    the arm would stop outside the limits, the limiter chooses a smaller share of the velocity, or
    brakes. So an arm that can stop within the limits at first can always do so.

    The limiter has no state; callers pass the last commanded motion.

    Attributes:
        acceleration: Largest acceleration of each joint (n,) [rad/s^2].
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
            limits: Limits of the joints.
            period: Time between two commands [s].
            config: Shares of the limits that the arm may use.

        Raises:
            InvalidValueError: if the config does not have one jerk for each joint.
        """
        config = config or VelocityLimiterConfig()
        n = limits.lower.size
        jerk = frozen_array(np.array(config.jerk), name="VelocityLimiterConfig.jerk", shape=(n,))
        self._period = period
        self._lower = limits.lower + config.position_margin
        self._upper = limits.upper - config.position_margin
        self._speed = config.velocity_scale * limits.velocity
        self.acceleration = config.acceleration_scale * limits.acceleration
        task = InputParameter(n)
        task.control_interface = ControlInterface.Velocity
        task.max_acceleration = self.acceleration.tolist()
        task.max_jerk = (config.jerk_scale * jerk).tolist()
        task.target_acceleration = [0.0] * n
        self._planner = [Ruckig(n), task]
        # A limiter in a Drake system lives until the interpreter ends; Ruckig's binding would then
        # report its objects as leaked.
        weakref.finalize(self, self._planner.clear)

    def step(self, motion: JointMotion, wanted: np.ndarray) -> JointMotion:
        """Returns the motion one period later.

        Args:
            motion: The current command.
            wanted: (n,) desired velocity [rad/s]; if any value is not finite, the arm brakes.
        """
        return self.guarded_step(motion, wanted, lambda postures: None).motion

    def braking(self, motion: JointMotion) -> np.ndarray:
        """Returns the velocities (K, n) [rad/s] of the steps that bring the arm to rest.

        The last velocity is zero; K is 0 for an arm at rest.

        Args:
            motion: The current command; its position is ignored.
        """
        rest, velocities = np.zeros_like(motion.velocity), []
        while motion.velocity.any() or motion.acceleration.any():
            motion = self._towards(motion, rest)
            velocities.append(motion.velocity)
        return np.array(velocities).reshape(-1, rest.size)

    def guarded_step(
        self,
        motion: JointMotion,
        wanted: np.ndarray,
        refuse: Callable[[np.ndarray], Reason | None],
        *,
        offset: np.ndarray | float = 0.0,
    ) -> GuardedStep[Reason]:
        """Returns the motion one period later, for an arm with forbidden postures.

        The step heads for the largest share of the desired velocity after which the arm can still
        brake within the joints' limits and in allowed postures; if there is none, the arm brakes.

        Args:
            motion: The current command.
            wanted: (n,) desired velocity [rad/s]; if any value is not finite, the arm brakes.
            refuse: Takes three postures (3, n) [rad]: after the step, halfway through the braking
                that would follow, and at its end. Returns why one of them is forbidden, or None.
                It is called only for steps that the joints' limits allow.
            offset: (n,) position of the real arm relative to its command [rad]; the step keeps the
                real arm within the joints' limits, too.
        """
        rest = np.zeros_like(motion.velocity)
        if not np.isfinite(wanted).all() or not wanted.any():
            return GuardedStep(self._towards(motion, rest), 1.0, None)
        excess = max(1.0, float((np.abs(wanted) / self._speed).max()))
        wanted = wanted / excess
        both, reason = np.array([rest, rest + offset]), None
        for share in _SHARES:
            after = self._towards(motion, share * wanted)
            # In velocity control Ruckig's position extrema always include 0, hence this start.
            braking = self._plan(after._replace(position=rest), rest)
            if not self._stays_inside(braking, after.position + both, motion.position + both):
                continue
            refusal = refuse(after.position + _ways(braking))
            if refusal is None:
                return GuardedStep(after, share / excess, reason)
            reason = refusal if reason is None else reason
        return GuardedStep(self._towards(motion, rest), 0.0, reason)

    def _towards(self, motion: JointMotion, velocity: np.ndarray) -> JointMotion:
        trajectory = self._plan(motion, velocity)
        position, reached, acceleration = trajectory.at_time(self._period)
        if trajectory.duration <= self._period and not velocity.any():
            return JointMotion.at_rest(np.array(position))  # The remaining speed is rounding.
        return JointMotion(np.array(position), np.array(reached), np.array(acceleration))

    def _stays_inside(self, braking: Trajectory, start: np.ndarray, before: np.ndarray) -> bool:
        """Returns whether an arm that brakes from `start` (K, n) [rad] obeys the position limits.

        `start` holds K positions; the motion `braking` is added to each. A joint that was outside
        the limits one period earlier, at `before` (K, n), may get no farther outside.
        """
        extrema = braking.position_extrema
        lowest = start + [one.min for one in extrema]
        highest = start + [one.max for one in extrema]
        return bool(
            (lowest >= np.minimum(self._lower, before)).all()
            and (highest <= np.maximum(self._upper, before)).all()
        )

    def _plan(self, motion: JointMotion, velocity: np.ndarray) -> Trajectory:
        ruckig, task = self._planner
        task.current_position = motion.position.tolist()
        task.current_velocity = motion.velocity.tolist()
        task.current_acceleration = motion.acceleration.tolist()
        task.target_velocity = velocity.tolist()
        # Replanning on the way leaves braking unchanged with time synchronization, but not with
        # phase synchronization.
        moving = velocity.any()
        task.synchronization = Synchronization.Phase if moving else Synchronization.Time
        # A trajectory is not reused: after a motion of zero duration it would keep its extrema.
        trajectory = Trajectory(velocity.size)
        result = ruckig.calculate(task, trajectory)
        if result not in (Result.Working, Result.Finished):
            raise InvalidValueError(
                f"Ruckig finds no motion from {motion} to the velocity {velocity} ({result}).",
                remedy="Pass positions, velocities and accelerations within the limits.",
            )
        return trajectory


def _ways(braking: Trajectory) -> np.ndarray:
    """Returns the joints' displacements (3, n) [rad] at the start, middle and end of braking."""
    middle, end = (braking.at_time(share * braking.duration)[0] for share in (0.5, 1.0))
    return np.array([[0.0] * len(end), middle, end])
