"""What the drivers of the real Panda and its hand report, as systems."""

import time

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from poil_drake.systems.lcm.mailbox import LcmMailbox
from poil_drake.systems.panda.lcm_messages import (
    Clock,
    HandStatus,
    PandaStatus,
)
from poil_drake.systems.panda.velocity_driver import NUM_JOINTS
from poil_drake.systems.statuses import RobotMode

_UNKNOWN = np.full(NUM_JOINTS, np.nan)

_HAND_GRACE = 0.1
"""A hand's opening is believed for so long after its status is not any more [s]."""


class PandaStatusReceiver(LeafSystem):
    """Shows the newest status of the Panda's driver.

    .. pydrake_system::

        name: PandaStatusReceiver
        output_ports:
        - position_measured
        - velocity_measured
        - torque_external
        - status

    Every output is state, taken from the mailbox once every period, in an unrestricted update, so
    that the discrete updates of the same instant see it. `position_measured` [rad],
    `velocity_measured` [rad/s] and `torque_external` [N m] are (7,), NaN before the first status.
    `status` (3,) holds the `RobotMode`, the age [s] and the share of commands that reach the robot
    in time. The age is by the driver's stamp, at the last update: it grows when statuses stop,
    arrive late or are repeated, and is negative where the driver's clock is ahead of ours. Before
    the first status these are OTHER, infinity and 0. An update raises a StationError where two
    drivers report in turns.
    """

    def __init__(
        self, *, mailbox: LcmMailbox[PandaStatus], period: float, clock: Clock = time.time
    ):
        """Constructs the receiver.

        Args:
            mailbox: Where statuses arrive.
            period: Of its looks at it [s].
            clock: The time now [s since the epoch].
        """
        super().__init__()
        self._mailbox, self._clock = mailbox, clock
        self._seen = self.DeclareAbstractState(Value[object]((None, np.inf)))
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._look)
        known = {self.abstract_state_ticket(self._seen)}
        for name in ("position", "velocity", "torque_external"):
            port = f"{name}_measured" if name != "torque_external" else name

            def calc(context: Context, output: BasicVector, name: str = name) -> None:
                status, _ = self._status(context)
                output.SetFromVector(_UNKNOWN if status is None else getattr(status, name))

            self.DeclareVectorOutputPort(port, NUM_JOINTS, calc, known)
        self.DeclareVectorOutputPort("status", 3, self._calc_status, known)

    def _status(self, context: Context) -> tuple[PandaStatus | None, float]:
        return context.get_abstract_state(self._seen).get_value()

    def _look(self, context: Context, state: State) -> None:
        self._mailbox.CheckOneSender()
        status = self._mailbox.newest
        age = np.inf if status is None else self._clock() - status.stamp
        state.get_mutable_abstract_state(self._seen).set_value((status, age))

    def _calc_status(self, context: Context, output: BasicVector) -> None:
        status, age = self._status(context)
        if status is None:
            output.SetFromVector([float(RobotMode.OTHER), np.inf, 0.0])
        else:
            output.SetFromVector([float(status.mode), age, status.success_rate])


class HandStatusReceiver(LeafSystem):
    """Shows how far the Panda's hand is open.

    .. pydrake_system::

        name: HandStatusReceiver
        output_ports:
        - width_measured

    `width_measured` (1,) [m] is state, taken from the mailbox once every period, in an unrestricted
    update. It is NaN before the first status, and once the newest has been more than `max_age` off
    the clock by its stamp for a while: what stops the whole robot is for others to say first.
    """

    def __init__(
        self,
        *,
        mailbox: LcmMailbox[HandStatus],
        period: float,
        max_age: float = 0.5,
        clock: Clock = time.time,
    ):
        """Constructs the receiver.

        Args:
            mailbox: Where statuses arrive.
            period: Of its looks at it [s].
            max_age: Of a status that is still believed [s]. The driver sends ten a second.
            clock: The time now [s since the epoch].
        """
        super().__init__()
        self._mailbox, self._max_age, self._clock = mailbox, max_age, clock
        # The width, and when it was last known.
        self._width = self.DeclareAbstractState(Value[object]((np.nan, -np.inf)))
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._look)
        self.DeclareVectorOutputPort(
            "width_measured", 1, self._calc_width, {self.abstract_state_ticket(self._width)}
        )

    def _look(self, context: Context, state: State) -> None:
        status = self._mailbox.newest
        known = status is not None and abs(self._clock() - status.stamp) <= self._max_age
        width, known_at = context.get_abstract_state(self._width).get_value()
        if status is not None and known:
            width, known_at = status.width, context.get_time()
        elif context.get_time() - known_at > _HAND_GRACE:
            width = np.nan
        state.get_mutable_abstract_state(self._width).set_value((width, known_at))

    def _calc_width(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([context.get_abstract_state(self._width).get_value()[0]])
