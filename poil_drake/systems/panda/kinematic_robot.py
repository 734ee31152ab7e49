"""A robot without dynamics that starts at the real robot's posture, for dry runs."""

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    InputPort,
    LeafSystem,
)

from poil_drake.robots.panda import NUM_JOINTS
from poil_drake.systems.control_period import CONTROL_PERIOD
from poil_drake.systems.panda.velocity_driver import PandaDriver

_HELD_WIDTH = 0.005
"""Smallest opening of the hand [m], as if it held an object."""


class KinematicRobot(LeafSystem):
    """Integrates velocities from the first measured position of the real arm.

    .. pydrake_system::

        name: KinematicRobot
        input_ports:
        - real_position
        - real_width
        - velocity
        - velocity_time
        - width
        output_ports:
        - position_measured
        - velocity_measured
        - torque_external
        - width_measured

    `position_measured` (7,) [rad] and `width_measured` (1,) [m] pass on `real_position` and
    `real_width` until the first update at which that input is finite. From then on, the position
    integrates `velocity` (7,) [rad/s], and the hand moves at 0.1 m/s towards `width` (1,) [m]. Arm
    and hand rest while their input is not connected or not finite. The hand never closes beyond
    5 mm, as if it held an object. `velocity_measured` (7,) [rad/s] is the velocity of the last
    update, zero before the first. The robot ignores `velocity_time`; `torque_external` is zero.
    """

    def __init__(self, *, period: float = CONTROL_PERIOD):
        """Constructs the robot.

        Args:
            period: The control period [s].
        """
        super().__init__()
        self._period = period
        self._real_position = self.DeclareVectorInputPort("real_position", NUM_JOINTS)
        self._real_width = self.DeclareVectorInputPort("real_width", 1)
        self._velocity = self.DeclareVectorInputPort("velocity", NUM_JOINTS)
        self.DeclareVectorInputPort("velocity_time", 1)
        self._width = self.DeclareVectorInputPort("width", 1)
        self._own_position = self.DeclareDiscreteState(np.full(NUM_JOINTS, np.nan))
        self._own_velocity = self.DeclareDiscreteState(np.zeros(NUM_JOINTS))
        self._own_width = self.DeclareDiscreteState([np.nan])
        self._declare_output("position_measured", self._own_position, self._real_position)
        self.DeclareStateOutputPort("velocity_measured", self._own_velocity)
        self._declare_output("width_measured", self._own_width, self._real_width)
        self.DeclareVectorOutputPort(
            "torque_external",
            NUM_JOINTS,
            lambda context, output: output.SetZero(),
            {self.nothing_ticket()},
        )
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._step)

    def _declare_output(self, name: str, own_index: int, real: InputPort) -> None:
        """Declares an output port for a state; it passes on `real` until the state is finite."""

        def calc(context: Context, output: BasicVector) -> None:
            own = context.get_discrete_state(own_index).value()
            output.SetFromVector(own if np.isfinite(own).all() else real.Eval(context))

        known = {self.discrete_state_ticket(own_index), real.ticket()}
        self.DeclareVectorOutputPort(name, real.size(), calc, known)

    def _step(self, context: Context, state: DiscreteValues) -> None:
        position = state.get_mutable_value(self._own_position)
        moved = state.get_mutable_value(self._own_velocity)
        width = state.get_mutable_value(self._own_width)
        if not np.isfinite(position).all():
            position[:] = self._real_position.Eval(context)
        else:
            wanted = self._velocity.Eval(context) if self._velocity.HasValue(context) else None
            moved[:] = wanted if wanted is not None and np.isfinite(wanted).all() else 0.0
            position += self._period * moved
        if not np.isfinite(width).all():
            width[:] = self._real_width.Eval(context)
        elif self._width.HasValue(context):
            goal = max(float(self._width.Eval(context)[0]), _HELD_WIDTH)
            if np.isfinite(goal):
                step = PandaDriver.hand_speed * self._period
                width[0] += min(max(goal - width[0], -step), step)
