"""The simulated Panda hand's interface: an opening width, followed at a limited speed."""

import math

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from poil_drake.robots.panda import MAX_HAND_WIDTH
from poil_drake.systems.panda.velocity_driver import PandaDriver


def step_width(*, width: float, wanted: float, speed: float, time_step: float) -> float:
    """Returns the commanded width [m], moved by at most speed * time_step towards `wanted`."""
    wanted = min(max(wanted, 0.0), MAX_HAND_WIDTH)
    change = speed * time_step
    return min(max(wanted, width - change), width + change)


class HandDriver(LeafSystem):
    """Converts a width command to the desired state of the finger's position controller.

    .. pydrake_system::

        name: HandDriver
        input_ports:
        - width
        - width_measured
        output_ports:
        - finger_position
        - finger_velocity

    Port `width` is the desired opening between the pads [m]; if it is NaN or not connected, the
    hand holds its opening. A width smaller than the object between the fingers grips the object;
    the actuator's effort limit bounds the force.

    `finger_position` [m] and `finger_velocity` [m/s] are those of one finger: half of the commanded
    width and half of its rate. Before the first step, and until the measured width is finite, they
    are half of the measured width and zero.
    """

    def __init__(self, *, speed: float = PandaDriver.hand_speed, time_step: float = 1 / 512):
        """Constructs the driver.

        Args:
            speed: Rate of change of the opening [m/s].
            time_step: The plant's time step [s].
        """
        super().__init__()
        self._speed, self._time_step = speed, time_step
        self._width = self.DeclareVectorInputPort("width", 1)
        self._measured = self.DeclareVectorInputPort("width_measured", 1)
        # Width [m] (NaN before the first step) and its rate [m/s].
        self._state = self.DeclareDiscreteState([math.nan, 0.0])
        state_ticket = self.discrete_state_ticket(self._state)
        self.DeclareVectorOutputPort(
            "finger_position", 1, self._calc_position, {state_ticket, self._measured.ticket()}
        )
        self.DeclareVectorOutputPort("finger_velocity", 1, self._calc_velocity, {state_ticket})
        self.DeclarePeriodicDiscreteUpdateEvent(time_step, 0.0, self._step)

    def Reset(self, context: Context) -> None:
        """Forgets the commanded width, so that the hand holds its next measured opening."""
        context.SetDiscreteState(self._state, np.array([math.nan, 0.0]))

    def _commanded_width(self, context: Context) -> float:
        """Returns the commanded width [m]; the measured one before the first step."""
        width = context.get_discrete_state(self._state).value()[0]
        return float(self._measured.Eval(context)[0] if math.isnan(width) else width)

    def _step(self, context: Context, state: DiscreteValues) -> None:
        width = self._commanded_width(context)
        if math.isnan(width):
            return
        wanted = self._width.Eval(context)[0] if self._width.HasValue(context) else math.nan
        new = width
        if not math.isnan(wanted):
            new = step_width(
                width=width, wanted=wanted, speed=self._speed, time_step=self._time_step
            )
        state.set_value(self._state, [new, (new - width) / self._time_step])

    def _calc_position(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, self._commanded_width(context) / 2)

    def _calc_velocity(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, context.get_discrete_state(self._state).value()[1] / 2)
