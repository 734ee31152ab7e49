"""The LCM messages of the Panda's driver: commands and statuses of the arm and the hand."""

import math
import struct
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from drake import (
    lcmt_panda_command,
    lcmt_panda_status,
    lcmt_schunk_wsg_command,
    lcmt_schunk_wsg_status,
)
from pydrake.manipulation import PandaControlMode

from poil_drake.errors import InvalidValueError
from poil_drake.robots.panda import NUM_JOINTS
from poil_drake.systems.lcm.network import check_channel
from poil_drake.systems.statuses import RobotMode

HAND_PERIOD = 0.1
"""Period of the hand driver's loop [s]."""

_MODES = {int(mode): mode for mode in RobotMode}

_OTHER_SENDERS = "Stop other programs that send on the channel of this message."


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
        fields: dict[str, str] = {}
        for field, channel in vars(self).items():
            check_channel(channel, f"poil.hardware.channels.{field}")
            other = fields.setdefault(channel, field)
            if other != field:
                raise InvalidValueError(
                    f"poil.hardware.channels.{other} and .{field} are both '{channel}'.",
                    remedy="Set a different channel for each.",
                )


def _decode(lcm_type: Any, message: bytes, kind: str) -> Any:
    try:
        return lcm_type.decode(message)
    except (ValueError, struct.error) as error:
        raise InvalidValueError(
            f"A message of {len(message)} bytes is not a {kind}: {error}.", remedy=_OTHER_SENDERS
        ) from error


class PandaStatus(NamedTuple):
    """A status of the arm's driver.

    Attributes:
        stamp: Time by the driver's clock [s since the epoch].
        position: (7,) measured positions [rad].
        velocity: (7,) measured velocities [rad/s].
        torque_external: (7,) external torques [N m], positive in the joints' positive directions.
        mode: The robot's mode.
        success_rate: Share of the last commands that reached the robot in time, in [0, 1].
        robot_stamp: Time by the robot's own clock [s]; NaN if unknown.
    """

    stamp: float
    position: np.ndarray
    velocity: np.ndarray
    torque_external: np.ndarray
    mode: RobotMode
    success_rate: float
    robot_stamp: float = math.nan


def decode_panda_status(message: bytes) -> PandaStatus:
    """Decodes an `lcmt_panda_status`.

    The driver reports external torques with the sign opposite to Drake's; the result has Drake's
    sign.

    Raises:
        InvalidValueError: if the message is of another type, the robot does not have 7 joints, its
            mode is unknown, or a joint value is not finite.
    """
    decoded = _decode(lcmt_panda_status, message, "Panda status")
    joints = np.array(
        [decoded.joint_position, decoded.joint_velocity, decoded.joint_torque_external]
    )
    mode = _MODES.get(decoded.robot_mode)
    if joints.shape != (3, NUM_JOINTS) or not np.isfinite(joints).all() or mode is None:
        raise InvalidValueError(
            f"A Panda status needs a known robot mode and {NUM_JOINTS} finite values per quantity, "
            f"but one has the mode {decoded.robot_mode} and the joint values {joints.tolist()}.",
            remedy=_OTHER_SENDERS,
        )
    return PandaStatus(
        stamp=1e-6 * decoded.utime,
        position=joints[0],
        velocity=joints[1],
        torque_external=-joints[2],
        mode=mode,
        success_rate=float(decoded.control_command_success_rate),
        robot_stamp=1e-6 * decoded.robot_utime,
    )


def encode_panda_status(status: PandaStatus, commanded_velocity: np.ndarray) -> bytes:
    """Encodes an `lcmt_panda_status` with the fields that the Franka driver fills.

    Args:
        status: The status.
        commanded_velocity: (7,) commanded velocities of the joints [rad/s].
    """
    message = lcmt_panda_status()
    message.utime = message.robot_utime = round(1e6 * status.stamp)
    message.num_joints = NUM_JOINTS
    zeros = [0.0] * NUM_JOINTS
    message.joint_position = message.joint_position_desired = status.position.tolist()
    message.joint_velocity = status.velocity.tolist()
    message.joint_velocity_desired = commanded_velocity.tolist()
    message.joint_acceleration_desired = zeros
    message.joint_torque = message.joint_torque_desired = zeros
    message.joint_torque_external = (-status.torque_external).tolist()
    message.control_command_success_rate = status.success_rate
    message.robot_mode = int(status.mode)
    return message.encode()


_MAX_JUMP, _MAX_SPEED = 0.1, 3.0
"""Between two statuses of the same robot, a joint moves by at most `_MAX_JUMP` [rad] plus
`_MAX_SPEED` [rad/s] times the elapsed time."""

_MAX_CLOCK_JUMP = 0.5
"""Between two statuses, the robot's clock drifts from the driver's clock by at most this [s]."""


def same_panda(before: PandaStatus, after: PandaStatus) -> bool:
    """Returns whether two consecutive statuses could have come from the same robot."""
    elapsed = after.stamp - before.stamp
    jump = float(np.abs(after.position - before.position).max())
    clock_jump = abs(after.robot_stamp - before.robot_stamp - elapsed)
    # An unknown robot_stamp (NaN) excludes nothing.
    return jump <= _MAX_JUMP + _MAX_SPEED * abs(elapsed) and not clock_jump > _MAX_CLOCK_JUMP


class PandaCommand(NamedTuple):
    """A command to the arm's driver.

    Attributes:
        stamp: Time by the sender's clock [s since the epoch].
        mode: The control mode that the sender expects, see `PandaControlMode`.
        sizes: Numbers of positions, velocities and torques in the command.
        velocity: (n,) desired velocities [rad/s].
    """

    stamp: float
    mode: int
    sizes: tuple[int, int, int]
    velocity: np.ndarray


def decode_panda_command(message: bytes) -> PandaCommand:
    """Decodes an `lcmt_panda_command`.

    Raises:
        InvalidValueError: if the message is of another type.
    """
    decoded = _decode(lcmt_panda_command, message, "Panda command")
    return PandaCommand(
        stamp=1e-6 * decoded.utime,
        mode=decoded.control_mode_expected,
        sizes=(decoded.num_joint_position, decoded.num_joint_velocity, decoded.num_joint_torque),
        velocity=np.array(decoded.joint_velocity, dtype=float),
    )


def encode_panda_command(velocity: np.ndarray, stamp: float) -> bytes:
    """Encodes an `lcmt_panda_command` in velocity mode.

    Args:
        velocity: (7,) desired velocities [rad/s], finite.
        stamp: The command's time [s since the epoch], by a clock that agrees with the driver's.
    """
    message = lcmt_panda_command()
    message.utime = round(1e6 * stamp)
    message.num_joint_velocity = NUM_JOINTS
    message.joint_velocity = velocity.tolist()
    message.control_mode_expected = int(PandaControlMode.kVelocity)
    return message.encode()


class HandOpening(NamedTuple):
    """The opening of the hand: the measured one in a status, the desired one in a command.

    The Franka driver uses the messages of the Schunk WSG for its hand. In the statuses, the force
    is always zero, and the speed only tells whether the hand is moving.

    Attributes:
        stamp: Time by the sender's clock [s since the epoch].
        width: Opening between the fingers [m].
    """

    stamp: float
    width: float


def decode_hand_status(message: bytes) -> HandOpening:
    """Decodes an `lcmt_schunk_wsg_status`.

    Raises:
        InvalidValueError: if the message is of another type, or its width is not finite.
    """
    decoded = _decode(lcmt_schunk_wsg_status, message, "hand status")
    return _hand_opening(decoded.utime, decoded.actual_position_mm)


def decode_hand_command(message: bytes) -> HandOpening:
    """Decodes an `lcmt_schunk_wsg_command`.

    Raises:
        InvalidValueError: if the message is of another type, or its width is not finite.
    """
    decoded = _decode(lcmt_schunk_wsg_command, message, "hand command")
    return _hand_opening(decoded.utime, decoded.target_position_mm)


def _hand_opening(utime: int, millimetres: float) -> HandOpening:
    if not math.isfinite(millimetres):
        raise InvalidValueError(
            f"The opening in a hand message is {millimetres} mm, which is not finite.",
            remedy=_OTHER_SENDERS,
        )
    return HandOpening(stamp=1e-6 * utime, width=1e-3 * millimetres)


def encode_hand_command(opening: HandOpening, force: float) -> bytes:
    """Encodes an `lcmt_schunk_wsg_command`.

    Args:
        opening: The desired opening, finite.
        force: Grip force on an object between the fingers [N].
    """
    message = lcmt_schunk_wsg_command()
    message.utime = round(1e6 * opening.stamp)
    message.target_position_mm = 1e3 * opening.width
    message.force = force
    return message.encode()


def encode_hand_status(opening: HandOpening, moving: bool) -> bytes:
    """Encodes an `lcmt_schunk_wsg_status` as the Franka driver fills it: without a force.

    Args:
        opening: The measured opening.
        moving: Whether the hand is moving; if so, the message says 5 mm/s, whatever the speed is.
    """
    message = lcmt_schunk_wsg_status()
    message.utime = round(1e6 * opening.stamp)
    message.actual_position_mm = 1e3 * opening.width
    message.actual_force = 0.0
    message.actual_speed_mm_per_s = 5.0 if moving else 0.0
    return message.encode()
