"""The driver of the simulated Panda hand, which follows a desired opening at a limited speed."""

import math

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from poil_drake.robots.panda import MAX_HAND_WIDTH
from poil_drake.systems.panda.velocity_driver import PandaDriver


class HandDriver(LeafSystem):
    """Converts a width command to the desired state of one finger, which the other finger mirrors.

    .. pydrake_system::

        name: HandDriver
        input_ports:
        - width
        - width_measured
        output_ports:
        - finger_position
        - finger_velocity

    Port `width` (1,) [m] is the desired opening between the pads, and is clipped to the hand's
    range; if it is NaN or not connected, the hand holds its opening. A width smaller than the
    object between the fingers grips the object; the actuator's effort limit bounds the force.
    `width_measured` (1,) [m] is the measured opening.

    `finger_position` (1,) [m] is half of the commanded width, and `finger_velocity` (1,) [m/s] is
    half of its rate. Until the first step with a finite `width_measured`, the position is half of
    `width_measured` and the velocity is zero.
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
        """Forgets the commanded width, so that the next step starts from the measured opening.

        Call it with this system's context after setting the plant's positions.
        """
        context.SetDiscreteState(self._state, np.array([math.nan, 0.0]))

    def _commanded_width(self, context: Context) -> float:
        """Returns the commanded width [m]; before the first step, the measured width."""
        width = context.get_discrete_state(self._state).value()[0]
        return float(self._measured.Eval(context)[0] if math.isnan(width) else width)

    def _step(self, context: Context, state: DiscreteValues) -> None:
        width = self._commanded_width(context)
        if math.isnan(width):
            return
        wanted = self._width.Eval(context)[0] if self._width.HasValue(context) else math.nan
        new, change = width, self._speed * self._time_step
        if not math.isnan(wanted):
            wanted = min(max(wanted, 0.0), MAX_HAND_WIDTH)
            new = min(max(wanted, width - change), width + change)
        state.set_value(self._state, [new, (new - width) / self._time_step])

    def _calc_position(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, self._commanded_width(context) / 2)

    def _calc_velocity(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, context.get_discrete_state(self._state).value()[1] / 2)
