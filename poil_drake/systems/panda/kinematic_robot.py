"""A robot that does at once what it is told, from where the real one stands: for dry runs."""

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    InputPort,
    LeafSystem,
)

from poil_drake.geometry.all_finite import all_finite
from poil_drake.systems.panda.velocity_driver import NUM_JOINTS


class KinematicRobot(LeafSystem):
    """Integrates velocities from the position at which the real arm is first measured.

    .. pydrake_system::

        name: KinematicRobot
        input_ports:
        - real_position
        - real_width
        - velocity
        - velocity_time
        - hand.width
        output_ports:
        - position_measured
        - velocity_measured
        - torque_external
        - hand.width_measured

    `real_position` (7,) [rad] and `real_width` (1,) [m] are what the outputs show, until an update
    finds them finite. From then on `velocity` (7,) [rad/s] is integrated, where it is
    connected and finite (`velocity_time` is there for whoever connects it, and not looked at), and
    the hand opens and closes at a fixed speed towards `hand.width` (1,)
    [m], though never below a width at which it is taken to hold something. Nothing pushes:
    `torque_external` is zero.
    """

    def __init__(self, *, period: float, hand_speed: float = 0.1, held_width: float = 0.005):
        """Constructs the robot.

        Args:
            period: The control period [s].
            hand_speed: Rate of change of the hand's opening [m/s].
            held_width: Smallest opening of the hand [m]: what it would hold is not there.
        """
        super().__init__()
        self._period, self._hand_speed, self._held_width = period, hand_speed, held_width
        self._real_position = self.DeclareVectorInputPort("real_position", NUM_JOINTS)
        self._real_width = self.DeclareVectorInputPort("real_width", 1)
        self._velocity = self.DeclareVectorInputPort("velocity", NUM_JOINTS)
        self.DeclareVectorInputPort("velocity_time", 1)
        self._wanted_width = self.DeclareVectorInputPort("hand.width", 1)
        unknown, zero = np.full(NUM_JOINTS, np.nan), np.zeros(NUM_JOINTS)
        self._index = [
            self.DeclareDiscreteState(unknown),
            self.DeclareDiscreteState(zero),
            self.DeclareDiscreteState([np.nan]),
        ]
        known = [self.discrete_state_ticket(index) for index in self._index]
        self.DeclareVectorOutputPort(
            "position_measured",
            NUM_JOINTS,
            lambda context, output: self._show(context, output, 0, self._real_position),
            {known[0], self._real_position.ticket()},
        )
        self.DeclareStateOutputPort("velocity_measured", self._index[1])
        self.DeclareVectorOutputPort(
            "hand.width_measured",
            1,
            lambda context, output: self._show(context, output, 2, self._real_width),
            {known[2], self._real_width.ticket()},
        )
        self.DeclareVectorOutputPort(
            "torque_external", NUM_JOINTS, self._calc_torque, {self.nothing_ticket()}
        )
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._step)

    def _show(self, context: Context, output: BasicVector, part: int, real: InputPort) -> None:
        own = context.get_discrete_state(self._index[part]).value()
        output.SetFromVector(own if all_finite(own) else real.Eval(context))

    def _calc_torque(self, context: Context, output: BasicVector) -> None:
        output.SetZero()

    def _step(self, context: Context, state: DiscreteValues) -> None:
        position, moved, width = (state.get_mutable_value(index) for index in self._index)
        if not all_finite(position):
            position[:] = self._real_position.Eval(context)
        else:
            wanted = self._velocity.Eval(context) if self._velocity.HasValue(context) else None
            moved[:] = wanted if wanted is not None and all_finite(wanted) else 0.0
            position += self._period * moved
        if not all_finite(width):
            width[:] = self._real_width.Eval(context)
        elif self._wanted_width.HasValue(context):
            goal = max(float(self._wanted_width.Eval(context)[0]), self._held_width)
            if np.isfinite(goal):
                step = self._hand_speed * self._period
                width[0] += min(max(goal - width[0], -step), step)
