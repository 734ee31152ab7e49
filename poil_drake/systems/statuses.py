"""Enumerations of the values that status ports output."""

from enum import IntEnum
from typing import Self


class DescribedEnum(IntEnum):
    """An IntEnum whose members also have a text for logs and reports.

    Attributes:
        text: A clause that describes the member.
    """

    text: str

    def __new__(cls, value: int, text: str = "") -> Self:
        """Creates a member from its number and its text."""
        member = int.__new__(cls, value)
        member._value_ = value
        member.text = text
        return member


class DetectorStatus(IntEnum):
    """The status of a `PartDetector`."""

    WAITING = 0  # No images yet.
    FOUND = 1
    NOT_FOUND = 2  # The last search failed; masks and cloud stay those of an earlier search.


class TrackerStatus(IntEnum):
    """The status of a point tracker."""

    WAITING = 0  # Images, query points or masks are missing.
    TRACKING = 1
    LOST = 2


class ControllerStatus(IntEnum):
    """The status of a `PointSetBcsdm`."""

    OK = 0
    LIMITED = 1  # The twist is scaled down to the speed limits.
    GOAL = 2  # The points are at the end of the reference, within tolerance.
    LOST = 3  # Fewer than 3 non-collinear points with confidence: the twist is zero.
    INVALID_INPUT = 4  # The gripper pose is not finite: the twist is zero.
    HOLDING = 5  # There is no reference to follow: the twist is zero.


class IkStatus(IntEnum):
    """The status of a `DifferentialInverseKinematics`."""

    OK = 0
    LIMITED = 1  # The arm follows the desired twist at reduced speed.
    STUCK = 2  # The arm cannot follow the twist at all: joint limit or singularity.
    INVALID_INPUT = 3  # An input is not finite; the arm brakes to rest.


class RobotMode(IntEnum):
    """The mode of the robot, numbered as in Drake's `lcmt_panda_status`."""

    OTHER = 0
    IDLE = 1
    MOVE = 2
    GUIDING = 3
    REFLEX = 4
    USER_STOPPED = 5
    AUTOMATIC_ERROR_RECOVERY = 6
