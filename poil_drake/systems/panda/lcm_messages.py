"""What is said between us and the Panda's driver over LCM."""

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from drake import (
    lcmt_panda_command,
    lcmt_panda_status,
    lcmt_schunk_wsg_command,
    lcmt_schunk_wsg_status,
)
from pydrake.manipulation import PandaControlMode

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.frozen_array import SharedOnCopy, frozen_array
from poil_drake.systems.panda.velocity_driver import NUM_JOINTS
from poil_drake.systems.statuses import RobotMode

Clock = Callable[[], float]
"""Returns the time now [s since the epoch]."""

HAND_PERIOD = 0.1
"""Of the loop of the hand's driver [s]."""

_ALONE = "Keep other senders off this channel."


_LONGEST_CHANNEL = 63
"""LCM's own limit."""


def check_channel(name: str, key: str) -> None:
    """Checks that LCM can have a channel of some name.

    Args:
        name: The channel's.
        key: Where it is written, for the error.

    Raises:
        InvalidValueError: if it cannot.
    """
    if not 0 < len(name.encode()) <= _LONGEST_CHANNEL:
        raise InvalidValueError(
            f"{key} is '{name}', which is no channel of LCM.",
            remedy=f"Write 1 to {_LONGEST_CHANNEL} letters.",
        )


@dataclass(frozen=True, kw_only=True)
class PandaChannels:
    """LCM channels of the Franka driver and its hand.

    Attributes:
        command: Commands to the arm.
        status: The arm's status.
        hand_command: Commands to the hand.
        hand_status: The hand's status.
    """

    command: str = "PANDA_COMMAND"
    status: str = "PANDA_STATUS"
    hand_command: str = "PANDA_HAND_COMMAND"
    hand_status: str = "PANDA_HAND_STATUS"

    def __post_init__(self) -> None:
        names = vars(self)
        for channel, name in names.items():
            check_channel(name, f"poil.hardware.channels.{channel}")
            twins = [other for other in names if other != channel and names[other] == name]
            if twins:
                raise InvalidValueError(
                    f"poil.hardware.channels.{channel} and .{twins[0]} are both '{name}'.",
                    remedy="Give each a channel of its own.",
                )


def _decode(lcm_type: Any, message: bytes, kind: str) -> Any:
    """Returns an LCM message; `kind` says in an InvalidValueError what it should have been."""
    try:
        return lcm_type.decode(message)
    except (ValueError, struct.error) as error:
        raise InvalidValueError(
            f"A message of {len(message)} bytes is no {kind}: {error}", remedy=_ALONE
        ) from error


@dataclass(frozen=True, kw_only=True, eq=False)
class PandaStatus(SharedOnCopy):
    """What the driver reports.

    Attributes:
        stamp: When, by the driver's clock [s since the epoch].
        position: (7,) measured [rad].
        velocity: (7,) measured [rad/s].
        torque_external: (7,) what others do to the joints [N m], positive along the joints.
        mode: Of the robot.
        success_rate: Part of the last commands that reached the robot in time, in [0, 1].
        robot_stamp: When, by the robot's own clock [s]; NaN where that is not told.
    """

    stamp: float
    position: np.ndarray
    velocity: np.ndarray
    torque_external: np.ndarray
    mode: RobotMode
    success_rate: float
    robot_stamp: float = math.nan

    def __post_init__(self) -> None:
        for name in ("position", "velocity", "torque_external"):
            value = frozen_array(
                getattr(self, name), name=f"PandaStatus.{name}", shape=(NUM_JOINTS,)
            )
            object.__setattr__(self, name, value)


def decode_panda_status(message: bytes) -> PandaStatus:
    """Returns what a message says.

    The driver reports external torques with the sign opposite to Drake's; it is turned here.

    Args:
        message: An encoded `lcmt_panda_status`.

    Raises:
        InvalidValueError: if it is none, of another robot, or has numbers that are not finite.
    """
    said = _decode(lcmt_panda_status, message, "status of a Panda")
    try:
        return PandaStatus(
            stamp=1e-6 * said.utime,
            position=np.array(said.joint_position),
            velocity=np.array(said.joint_velocity),
            torque_external=-np.array(said.joint_torque_external),
            mode=RobotMode(said.robot_mode),
            success_rate=float(said.control_command_success_rate),
            robot_stamp=1e-6 * said.robot_utime,
        )
    except ValueError as error:
        raise InvalidValueError(
            f"This is no status of a Panda that can be used: {error}", remedy=_ALONE
        ) from error


_LARGEST_LEAP, _FASTEST = 0.1, 3.0
"""A joint cannot have gone farther than so far [rad], and at such a speed [rad/s], between two
statuses; repeated and late ones may be a while apart."""

_CLOCK_LEAP = 0.5
"""By so much [s] the robot's clock differs from the driver's in one status and in the next only
where these are of two robots."""


def same_panda(before: PandaStatus, after: PandaStatus) -> bool:
    """Returns whether two statuses that came one after the other can be of one robot."""
    passed = after.stamp - before.stamp
    leap = float(np.abs(after.position - before.position).max())
    clock_leap = abs(after.robot_stamp - before.robot_stamp - passed)
    # A NaN is no sign of anything.
    return leap <= _LARGEST_LEAP + _FASTEST * abs(passed) and not clock_leap > _CLOCK_LEAP


def encode_panda_command(velocity: np.ndarray, stamp: float) -> bytes:
    """Returns an encoded `lcmt_panda_command` in velocity mode.

    Args:
        velocity: (7,) [rad/s], finite.
        stamp: When, by the clock that the driver compares it with [s since the epoch].
    """
    command = lcmt_panda_command()
    command.utime = round(1e6 * stamp)
    command.num_joint_velocity = NUM_JOINTS
    command.joint_velocity = velocity.tolist()
    command.control_mode_expected = int(PandaControlMode.kVelocity)
    return command.encode()


@dataclass(frozen=True, kw_only=True)
class HandStatus:
    """What the hand's driver reports.

    Attributes:
        stamp: When, by the driver's clock [s since the epoch].
        width: Opening between the fingers [m].
    """

    stamp: float
    width: float


def decode_hand_status(message: bytes) -> HandStatus:
    """Returns what a message says.

    The Franka driver speaks of its hand in the messages of the Schunk WSG. The force in them is
    always zero, and the speed invented, so neither is looked at.

    Args:
        message: An encoded `lcmt_schunk_wsg_status`.

    Raises:
        InvalidValueError: if it is none, or its width is not finite.
    """
    said = _decode(lcmt_schunk_wsg_status, message, "status of a hand")
    if not math.isfinite(said.actual_position_mm):
        raise InvalidValueError(
            f"The hand is said to be {said.actual_position_mm} mm open.", remedy=_ALONE
        )
    return HandStatus(stamp=1e-6 * said.utime, width=1e-3 * said.actual_position_mm)


def encode_hand_command(width: float, force: float, stamp: float) -> bytes:
    """Returns an encoded `lcmt_schunk_wsg_command`.

    Args:
        width: Wanted opening [m], finite.
        force: Of the grip, where something is in the way [N].
        stamp: When [s since the epoch].
    """
    command = lcmt_schunk_wsg_command()
    command.utime = round(1e6 * stamp)
    command.target_position_mm = 1e3 * width
    command.force = force
    return command.encode()


@dataclass(frozen=True, kw_only=True, eq=False)
class PandaCommand(SharedOnCopy):
    """What the driver is told.

    Attributes:
        stamp: When, by the sender's clock [s since the epoch].
        mode: The control mode that the sender expects, see `PandaControlMode`.
        sizes: How many positions, velocities and torques it holds.
        velocity: (n,) wanted [rad/s].
    """

    stamp: float
    mode: int
    sizes: tuple[int, int, int]
    velocity: np.ndarray


def decode_panda_command(message: bytes) -> PandaCommand:
    """Returns what a message says.

    Args:
        message: An encoded `lcmt_panda_command`.

    Raises:
        InvalidValueError: if it is none.
    """
    said = _decode(lcmt_panda_command, message, "command to a Panda")
    return PandaCommand(
        stamp=1e-6 * said.utime,
        mode=said.control_mode_expected,
        sizes=(said.num_joint_position, said.num_joint_velocity, said.num_joint_torque),
        velocity=np.array(said.joint_velocity, dtype=float),
    )


def encode_panda_status(status: PandaStatus, commanded_velocity: np.ndarray) -> bytes:
    """Returns an encoded `lcmt_panda_status`, filled as far as the Franka driver fills it.

    Args:
        status: What to say.
        commanded_velocity: (7,) what the joints are told [rad/s].
    """
    said = lcmt_panda_status()
    said.utime = said.robot_utime = round(1e6 * status.stamp)
    said.num_joints = NUM_JOINTS
    nothing = [0.0] * NUM_JOINTS
    said.joint_position = said.joint_position_desired = status.position.tolist()
    said.joint_velocity = status.velocity.tolist()
    said.joint_velocity_desired = commanded_velocity.tolist()
    said.joint_acceleration_desired = said.joint_torque = said.joint_torque_desired = nothing
    said.joint_torque_external = (-status.torque_external).tolist()
    said.control_command_success_rate = status.success_rate
    said.robot_mode = int(status.mode)
    return said.encode()


@dataclass(frozen=True, kw_only=True)
class HandCommand:
    """What the hand's driver is told.

    Attributes:
        stamp: When, by the sender's clock [s since the epoch].
        width: Wanted opening [m].
        force: Of the grip [N].
    """

    stamp: float
    width: float
    force: float


def decode_hand_command(message: bytes) -> HandCommand:
    """Returns what a message says.

    Args:
        message: An encoded `lcmt_schunk_wsg_command`.

    Raises:
        InvalidValueError: if it is none, or not finite.
    """
    said = _decode(lcmt_schunk_wsg_command, message, "command to a hand")
    if not (math.isfinite(said.target_position_mm) and math.isfinite(said.force)):
        raise InvalidValueError(
            f"The hand is told to open {said.target_position_mm} mm, with {said.force} N.",
            remedy=_ALONE,
        )
    return HandCommand(
        stamp=1e-6 * said.utime, width=1e-3 * said.target_position_mm, force=said.force
    )


def encode_hand_status(status: HandStatus, moving: bool) -> bytes:
    """Returns an encoded `lcmt_schunk_wsg_status` as the Franka driver fills it: it knows no force.

    Args:
        status: What to say.
        moving: Whether the hand is busy; the driver then claims 5 mm/s, whatever the speed.
    """
    said = lcmt_schunk_wsg_status()
    said.utime = round(1e6 * status.stamp)
    said.actual_position_mm = 1e3 * status.width
    said.actual_force = 0.0
    said.actual_speed_mm_per_s = 5.0 if moving else 0.0
    return said.encode()
