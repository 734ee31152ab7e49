"""Converts the gripper's desired twist to joint velocities."""

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from poil_drake.errors import InvalidValueError
from poil_drake.robots.differential_ik import (
    DifferentialInverseKinematicsConfig,
    approach_velocity,
    resolve_twist,
)
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.control_period import CONTROL_PERIOD
from poil_drake.systems.ik.arm_kinematics import ArmKinematics, MakePandaKinematics
from poil_drake.systems.statuses import IkStatus

_STUCK_SCALE = 0.02
"""The status is STUCK if the arm can achieve less than this fraction of the twist."""

_FULL_SCALE = 0.99
"""The status is LIMITED if the arm achieves less than this fraction of the twist."""


class DifferentialInverseKinematics(LeafSystem):
    """Differential inverse kinematics that keeps the direction of the twist.

    .. pydrake_system::

        name: DifferentialInverseKinematics
        input_ports:
        - spatial_velocity
        - position_measured
        output_ports:
        - velocity
        - scale
        - status
        - command_time

    Port `spatial_velocity` (6,) is (ω [rad/s], v [m/s]) of the gripper frame in the world;
    `position_measured` (n,) [rad] holds the arm's joint positions. The mathematics is in
    `poil_drake.robots.differential_ik`. Every output is discrete state, updated at the control
    period; there is no direct feedthrough.

    - `velocity` (n,) [rad/s]: zero before the first update.
    - `scale` (1,): the achieved fraction of the twist; 1 before the first update and for a zero
      twist, 0 while an input is not finite.
    - `status` (1,): an `IkStatus`; OK before the first update.
    - `command_time` (1,) [s]: the time at which `velocity` was last computed, so that a driver can
      detect a stale command; minus infinity before the first update.

    While an input is not finite, the status is INVALID_INPUT and the velocity goes to zero as fast
    as the joints' acceleration limits allow; from rest it stays exactly zero. The system does not
    check the age of its inputs: the source of the twist must output zero when its data is stale.
    """

    def __init__(
        self,
        *,
        kinematics: ArmKinematics | None = None,
        period: float = CONTROL_PERIOD,
        config: DifferentialInverseKinematicsConfig | None = None,
        stopwatch: Stopwatch | None = None,
    ):
        """Constructs the system.

        Args:
            kinematics: The arm and its gripper frame; None for a Panda at the world's origin.
            period: The control period [s].
            config: Margins and gains.
            stopwatch: Records the durations of the updates as "control".

        Raises:
            InvalidValueError: if the nominal posture does not have one value for each joint, or the
                arm has more than 7 joints.
        """
        super().__init__()
        self._stopwatch = stopwatch or Stopwatch()
        self._kinematics = kinematics or MakePandaKinematics()
        self._period = period
        self._config = config or DifferentialInverseKinematicsConfig()
        n = self._kinematics.num_joints
        posture = self._config.nominal_posture
        if n > 7:
            raise InvalidValueError(
                f"The arm has {n} joints, more than 7.", remedy="Use an arm with at most 7 joints."
            )
        if len(posture) != n:
            raise InvalidValueError(
                f"nominal_posture has {len(posture)} values, but the arm has {n} joints.",
                remedy="Set one value for each joint.",
            )
        self._scratch = self._kinematics.declare_scratch(self)
        self._twist = self.DeclareVectorInputPort("spatial_velocity", 6)
        self._joints = self.DeclareVectorInputPort("position_measured", n)
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
            previous = discrete_state.value(self._state["velocity"])
            velocity, scale, status = self._resolve(context, previous)
            for name, value in (
                ("velocity", velocity),
                ("scale", [scale]),
                ("status", [float(status)]),
                ("command_time", [context.get_time()]),
            ):
                discrete_state.set_value(self._state[name], value)

    def _resolve(
        self, context: Context, previous: np.ndarray
    ) -> tuple[np.ndarray, float, IkStatus]:
        twist, joints = self._twist.Eval(context), self._joints.Eval(context)
        config, limits = self._config, self._kinematics.joint_limits
        rest = np.zeros_like(previous)
        if not np.isfinite(twist).all() or not np.isfinite(joints).all():
            braking = config.acceleration_scale * limits.acceleration
            velocity = approach_velocity(previous, rest, braking, self._period)
            return velocity, 0.0, IkStatus.INVALID_INPUT
        if not twist.any() and not previous.any():
            return rest, 1.0, IkStatus.OK
        J = self._kinematics.jacobian(self._scratch.Eval(context), joints)
        answer = resolve_twist(twist, J, joints, previous, limits, config, self._period)
        if answer.reachable_scale < _STUCK_SCALE:
            status = IkStatus.STUCK
        else:
            status = IkStatus.LIMITED if answer.scale < _FULL_SCALE else IkStatus.OK
        return answer.velocity, answer.scale, status
