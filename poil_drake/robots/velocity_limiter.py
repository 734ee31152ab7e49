"""Joint velocities that an arm can follow, and stop from, within all of its limits."""

import weakref
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from ruckig import ControlInterface, InputParameter, Result, Ruckig, Synchronization, Trajectory

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.all_finite import all_finite
from poil_drake.geometry.frozen_array import frozen_array
from poil_drake.robots.joint_limits import JointLimits

Reason = TypeVar("Reason")

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


class GuardedStep(NamedTuple, Generic[Reason]):
    """A step of the limiter, and how much of what was wanted it is.

    Attributes:
        motion: One period later.
        share: The part of the wanted velocity that the arm goes for, in [0, 1]: 1 where nothing
            stands against it, less beyond the speed limits, 0 where the arm brakes instead.
        reason: Why not more of it was allowed; None where all was, or the joints' own limits were
            what stood against it.
    """

    motion: JointMotion
    share: float
    reason: Reason | None


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
        self.acceleration = config.acceleration_scale * limits.acceleration
        task = InputParameter(n)
        task.control_interface = ControlInterface.Velocity
        task.max_acceleration = self.acceleration.tolist()
        task.max_jerk = (config.jerk_scale * jerk).tolist()
        task.target_acceleration = [0.0] * n
        self._planner = [Ruckig(n), task]
        # Where the limiter lives until the interpreter ends, as in a Drake system, Ruckig's
        # binding would call what is left a leak.
        weakref.finalize(self, self._planner.clear)

    def step(self, motion: JointMotion, wanted: np.ndarray) -> JointMotion:
        """Returns the motion one period later.

        Args:
            motion: What is commanded now.
            wanted: (n,) velocity [rad/s]; where it is not finite, rest is wanted.
        """
        return self.guarded_step(motion, wanted, lambda postures: None).motion

    def braking(self, motion: JointMotion) -> np.ndarray:
        """Returns the velocities (K, n) [rad/s] of the steps that bring the arm to rest.

        The last one is zero; there is none for an arm that rests.

        Args:
            motion: What is commanded now. Its position does not matter.
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
        offset: np.ndarray | None = None,
    ) -> GuardedStep[Reason]:
        """Returns the motion one period later, for an arm that may not stand everywhere.

        Of the parts of the wanted velocity the largest is taken after which the arm can still brake
        within the joints' limits and where it is allowed to be; if there is none, the arm brakes.

        Args:
            motion: What is commanded now.
            wanted: (n,) velocity [rad/s]; where it is not finite, rest is wanted.
            refuse: Given postures (3, n) [rad], says why one of them is not allowed, or None. They
                are those after the step, half-way through the braking that would follow, and at the
                end of it. It is asked about a step only if the joints' limits allow that.
            offset: (n,) how far the arm really is from what is commanded [rad]: such an arm must
                stay within the joints' limits as well. None: not at all.
        """
        rest = np.zeros_like(motion.velocity)
        if not all_finite(wanted) or not wanted.any():
            return GuardedStep(self._towards(motion, rest), 1.0, None)
        excess = max(1.0, float((np.abs(wanted) / self._speed).max()))
        wanted = wanted / excess
        reason = None
        for share in _SHARES:
            after = self._towards(motion, share * wanted)
            # Ruckig's extrema of a motion to a velocity always have zero among them: the start.
            braking = self._plan(after._replace(position=rest), rest)
            if not self._stays_inside(braking, after.position, motion.position):
                continue
            if offset is not None and not self._stays_inside(
                braking, after.position + offset, motion.position + offset
            ):
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
            return JointMotion.at_rest(np.array(position))  # What is left is rounding.
        return JointMotion(np.array(position), np.array(reached), np.array(acceleration))

    def _stays_inside(self, braking: Trajectory, start: np.ndarray, before: np.ndarray) -> bool:
        """Returns whether braking from `start` ends within the limits, or no farther outside."""
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
        # Where the joints only come to rest together, braking stays the same when it is planned
        # anew on the way; where their phases are coupled, it need not.
        moving = velocity.any()
        task.synchronization = Synchronization.Phase if moving else Synchronization.Time
        # A new one each time: one that held a motion of no length keeps its extrema.
        trajectory = Trajectory(velocity.size)
        result = ruckig.calculate(task, trajectory)
        if result not in (Result.Working, Result.Finished):
            raise InvalidValueError(
                f"No motion from {motion} to the velocity {velocity} was found ({result}).",
                remedy="Pass positions, velocities and accelerations within the limits.",
            )
        return trajectory


def _ways(braking: Trajectory) -> np.ndarray:
    """Returns how far the joints went (3, n) [rad] at the start, the middle and the end."""
    middle, end = (braking.at_time(share * braking.duration)[0] for share in (0.5, 1.0))
    return np.array([[0.0] * len(end), middle, end])
