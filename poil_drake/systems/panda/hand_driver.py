"""The simulated Panda hand's interface: an opening width, followed at a limited speed."""

import math

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

LARGEST_WIDTH = 0.08
"""Opening of the Panda hand [m]."""


def step_width(*, width: float, wanted: float, speed: float, time_step: float) -> float:
    """Moves the commanded width [m] towards the wanted one by at most speed * time_step."""
    wanted = min(max(wanted, 0.0), LARGEST_WIDTH)
    change = speed * time_step
    return min(max(wanted, width - change), width + change)


class HandDriver(LeafSystem):
    """Turns a width command into the desired state of the finger's position controller.

    .. pydrake_system::

        name: HandDriver
        input_ports:
        - width
        - width_measured
        output_ports:
        - finger_position
        - finger_velocity

    Port `width` is the wanted opening between the pads [m]; where it is NaN or not connected, the
    hand holds its opening. Wanting less than what is between the fingers grips it: the force is
    limited by the actuator's effort limit.

    `finger_position` [m] and `finger_velocity` [m/s] are those of one finger, half of the width's.
    Before the first step, and until a measured width is a number, they are half the measured width
    and zero.
    """

    def __init__(self, *, speed: float, time_step: float):
        super().__init__()
        self._speed, self._time_step = speed, time_step
        self._width = self.DeclareVectorInputPort("width", 1)
        self._measured = self.DeclareVectorInputPort("width_measured", 1)
        # Width [m], its rate [m/s]; NaN stands for "not stepped yet".
        self._state = self.DeclareDiscreteState([math.nan, 0.0])
        state_ticket = self.discrete_state_ticket(self._state)
        self.DeclareVectorOutputPort(
            "finger_position", 1, self._calc_position, {state_ticket, self._measured.ticket()}
        )
        self.DeclareVectorOutputPort("finger_velocity", 1, self._calc_velocity, {state_ticket})
        self.DeclarePeriodicDiscreteUpdateEvent(time_step, 0.0, self._step)

    def Reset(self, context: Context) -> None:
        """Forgets the commanded width, so that the hand holds the opening measured next."""
        context.SetDiscreteState(self._state, np.array([math.nan, 0.0]))

    def _step(self, context: Context, state: DiscreteValues) -> None:
        commanded = state.get_mutable_value(self._state)
        old = commanded[0]
        if math.isnan(old):
            old = self._measured.Eval(context)[0]
            if math.isnan(old):
                return
        wanted = self._width.Eval(context)[0] if self._width.HasValue(context) else math.nan
        new = old
        if not math.isnan(wanted):
            new = step_width(width=old, wanted=wanted, speed=self._speed, time_step=self._time_step)
        commanded[:] = new, (new - old) / self._time_step

    def _calc_position(self, context: Context, output: BasicVector) -> None:
        width = context.get_discrete_state(self._state).value()[0]
        if math.isnan(width):
            width = self._measured.Eval(context)[0]
        output.SetAtIndex(0, width / 2)

    def _calc_velocity(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, context.get_discrete_state(self._state).value()[1] / 2)
