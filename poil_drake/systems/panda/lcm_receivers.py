"""Systems that show the statuses of the real Panda's and its hand's drivers."""

import time

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from poil_drake.robots.panda import NUM_JOINTS
from poil_drake.systems.control_period import CONTROL_PERIOD
from poil_drake.systems.lcm.mailbox import LcmMailbox
from poil_drake.systems.lcm.network import Clock
from poil_drake.systems.panda.lcm_messages import HandOpening, PandaStatus
from poil_drake.systems.statuses import RobotMode

_MAX_HAND_AGE = 0.5
"""Largest age of a valid status of the hand [s]; the driver sends ten a second."""

_HAND_GRACE = 0.1
"""The opening of a hand stays valid for this long after its status became too old [s], so that the
supervisor detects a failure of the whole robot first."""


class FrankaStatusReceiver(LeafSystem):
    """Shows the newest status of the Panda's driver.

    .. pydrake_system::

        name: FrankaStatusReceiver
        output_ports:
        - position_measured
        - velocity_measured
        - torque_external
        - status

    Drake's `PandaStatusReceiver` outputs zeros before the first message, has no port for the robot
    mode or the age of the status, and accepts messages that are late or not finite.

    Every output is state. An unrestricted update takes it from the mailbox once per period, so that
    the discrete updates of the same instant see it. `position_measured` [rad], `velocity_measured`
    [rad/s] and `torque_external` [N m] are (7,), NaN before the first status. `status` (3,) holds
    the `RobotMode`, the age [s] and the share of commands that reach the robot in time. The age is
    the clock at the last update minus the driver's stamp: it grows when statuses stop, arrive late
    or repeat, and is negative if the driver's clock is ahead of ours. Before the first status these
    are OTHER, infinity and 0. An update raises a StationError if two drivers take turns.
    """

    def __init__(
        self,
        *,
        mailbox: LcmMailbox[PandaStatus],
        period: float = CONTROL_PERIOD,
        clock: Clock = time.time,
    ):
        """Constructs the receiver.

        Args:
            mailbox: Receives the statuses.
            period: Period of the updates [s].
            clock: The current time [s since the epoch].
        """
        super().__init__()
        self._mailbox, self._clock = mailbox, clock
        self._received = self.DeclareAbstractState(Value[object]((None, np.inf)))
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)
        unknown = np.full(NUM_JOINTS, np.nan)
        for port, field in (
            ("position_measured", "position"),
            ("velocity_measured", "velocity"),
            ("torque_external", "torque_external"),
        ):

            def calc(context: Context, output: BasicVector, field: str = field) -> None:
                status, _ = self._status(context)
                output.SetFromVector(unknown if status is None else getattr(status, field))

            self.DeclareVectorOutputPort(port, NUM_JOINTS, calc, {self.xa_ticket()})
        self.DeclareVectorOutputPort("status", 3, self._calc_status, {self.xa_ticket()})

    def _status(self, context: Context) -> tuple[PandaStatus | None, float]:
        return context.get_abstract_state(self._received).get_value()

    def _update(self, context: Context, state: State) -> None:
        self._mailbox.CheckOneSender()
        status = self._mailbox.newest
        age = np.inf if status is None else self._clock() - status.stamp
        state.get_mutable_abstract_state(self._received).set_value((status, age))

    def _calc_status(self, context: Context, output: BasicVector) -> None:
        status, age = self._status(context)
        if status is None:
            output.SetFromVector([float(RobotMode.OTHER), np.inf, 0.0])
        else:
            output.SetFromVector([float(status.mode), age, status.success_rate])


class HandStatusReceiver(LeafSystem):
    """Shows the opening of the Panda's hand.

    .. pydrake_system::

        name: HandStatusReceiver
        output_ports:
        - width_measured

    `width_measured` (1,) [m] is state; an unrestricted update takes it from the mailbox once per
    period. It is NaN before the first status, and once the stamp of the newest has differed from
    the clock by more than 0.5 s for 0.1 s.
    """

    def __init__(
        self,
        *,
        mailbox: LcmMailbox[HandOpening],
        period: float = CONTROL_PERIOD,
        clock: Clock = time.time,
    ):
        """Constructs the receiver.

        Args:
            mailbox: Receives the statuses.
            period: Period of the updates [s].
            clock: The current time [s since the epoch].
        """
        super().__init__()
        self._mailbox, self._clock = mailbox, clock
        # The width, and the time at which it was last valid.
        self._width = self.DeclareAbstractState(Value[object]((np.nan, -np.inf)))
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)
        self.DeclareVectorOutputPort("width_measured", 1, self._calc_width, {self.xa_ticket()})

    def _update(self, context: Context, state: State) -> None:
        status, time_now = self._mailbox.newest, context.get_time()
        width, valid_at = context.get_abstract_state(self._width).get_value()
        if status is not None and abs(self._clock() - status.stamp) <= _MAX_HAND_AGE:
            width, valid_at = status.width, time_now
        elif time_now - valid_at > _HAND_GRACE:
            width = np.nan
        state.get_mutable_abstract_state(self._width).set_value((width, valid_at))

    def _calc_width(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([context.get_abstract_state(self._width).get_value()[0]])
