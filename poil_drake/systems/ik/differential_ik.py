"""Turns the twist wanted of the gripper into joint velocities."""

from dataclasses import dataclass, field

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.all_finite import all_finite
from poil_drake.robots.joint_limits import JointLimits
from poil_drake.robots.twist_resolution import (
    ResolvedTwist,
    TwistResolutionConfig,
    approach_velocity,
    resolve_twist,
)
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.ik.arm_kinematics import ArmKinematics
from poil_drake.systems.statuses import IkStatus


@dataclass(frozen=True, kw_only=True)
class DifferentialIkConfig:
    """How the arm follows a twist.

    Attributes:
        resolution: Margins and gains.
        stuck_scale: Below this fraction of the twist the arm counts as stuck.
        full_scale: From this fraction of the twist on it counts as followed.
    """

    resolution: TwistResolutionConfig = field(default_factory=TwistResolutionConfig)
    stuck_scale: float = 0.02
    full_scale: float = 0.99


class DifferentialIk(LeafSystem):
    """Differential inverse kinematics that keeps the direction of the twist.

    .. pydrake_system::

        name: DifferentialIk
        input_ports:
        - spatial_velocity
        - panda.position_measured
        output_ports:
        - velocity
        - scale
        - status
        - command_time

    Port `spatial_velocity` (6,) is (ω [rad/s], v [m/s]) of the gripper frame in the world. The
    mathematics is in `poil_drake.robots.twist_resolution`. Every output is discrete state, sampled
    at the control period: nothing feeds through.

    - `velocity` (n,) [rad/s]: zero before the first update.
    - `scale` (1,): the fraction of the twist that is achieved; 1 before the first update and when
      no motion is wanted, 0 while an input is not finite.
    - `status` (1,): an `IkStatus`; OK before the first update.
    - `command_time` (1,) [s]: when `velocity` was last computed, so that a driver can tell a stale
      command; minus infinity before the first update.

    While an input is not finite the status is INVALID_INPUT and the velocity goes to zero as fast
    as the joints' acceleration limits allow; from rest it stays exactly zero. Inputs are taken as
    they are at the update: whoever gives the twist sees to it that a stale one is zero.
    """

    def __init__(
        self,
        *,
        kinematics: ArmKinematics,
        period: float,
        config: DifferentialIkConfig | None = None,
        limits: JointLimits | None = None,
        stopwatch: Stopwatch | None = None,
    ):
        """Constructs the system.

        Args:
            kinematics: The arm and its gripper frame.
            period: The control period [s].
            config: Margins and gains.
            limits: What the joints may do; None: what the plant says.
            stopwatch: Where to note how long updates take, under "control".

        Raises:
            InvalidValueError: if the nominal posture or the limits are of another number of
                joints, or the limits leave no room to move.
        """
        super().__init__()
        self._stopwatch = stopwatch or Stopwatch()
        n = kinematics.num_joints
        self._kinematics = kinematics
        self._period = period
        self._config = config or DifferentialIkConfig()
        self._limits = limits or kinematics.joint_limits
        posture = self._config.resolution.nominal_posture
        if n > 7 or len(posture) != n or self._limits.lower.size != n:
            raise InvalidValueError(
                f"The arm has {n} joints, but DifferentialIk got a nominal posture of "
                f"{len(posture)} and limits of {self._limits.lower.size}.",
                remedy="Use an arm of up to 7 joints with a posture and limits of that size.",
            )
        self._scratch = kinematics.declare_scratch(self)
        self._twist = self.DeclareVectorInputPort("spatial_velocity", 6)
        self._joints = self.DeclareVectorInputPort("panda.position_measured", n)
        outputs = {
            "velocity": np.zeros(n),
            "scale": np.ones(1),
            "status": np.array([float(IkStatus.OK)]),
            "command_time": np.array([-np.inf]),
        }
        self._state = {name: self.DeclareDiscreteState(value) for name, value in outputs.items()}
        for name, index in self._state.items():
            self.DeclareStateOutputPort(name, index)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        with self._stopwatch.measure("control"):
            self._advance(context, discrete_state)

    def _advance(self, context: Context, discrete_state: DiscreteValues) -> None:
        state = {
            name: discrete_state.get_mutable_value(index) for name, index in self._state.items()
        }
        velocity, scale, status = self._resolve(context, state["velocity"])
        state["velocity"][:] = velocity
        state["scale"][0] = scale
        state["status"][0] = status
        state["command_time"][0] = context.get_time()

    def _resolve(
        self, context: Context, previous: np.ndarray
    ) -> tuple[np.ndarray, float, IkStatus]:
        twist, joints = self._twist.Eval(context), self._joints.Eval(context)
        config, limits = self._config.resolution, self._limits
        if not all_finite(twist) or not all_finite(joints):
            braking = config.acceleration_scale * limits.acceleration
            rest = np.zeros_like(previous)
            velocity = approach_velocity(previous, rest, braking, self._period)
            return velocity, 0.0, IkStatus.INVALID_INPUT
        if not twist.any() and not previous.any():
            return np.zeros_like(previous), 1.0, IkStatus.OK
        J = self._kinematics.jacobian(self._scratch.Eval(context), joints)
        answer = resolve_twist(twist, J, joints, previous, limits, config, self._period)
        return answer.velocity, answer.scale, self._judge(answer)

    def _judge(self, answer: ResolvedTwist) -> IkStatus:
        if answer.reachable_scale < self._config.stuck_scale:
            return IkStatus.STUCK
        return IkStatus.LIMITED if answer.scale < self._config.full_scale else IkStatus.OK
