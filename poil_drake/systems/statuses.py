"""What the numbers on status ports mean."""

from enum import IntEnum


class DetectorStatus(IntEnum):
    """Of `PartDetector`."""

    WAITING = 0  # No images yet.
    FOUND = 1
    NOT_FOUND = 2  # The last search failed; the results of an earlier one are still shown.


class TrackerStatus(IntEnum):
    """Of a point tracker."""

    WAITING = 0  # Images, query points or masks are still missing.
    TRACKING = 1
    LOST = 2


class ControllerStatus(IntEnum):
    """Of `PointSetBcsdm`."""

    OK = 0
    LIMITED = 1  # The twist was scaled down to the speed limits.
    GOAL = 2  # The end of the reference is reached within tolerance.
    LOST = 3  # Fewer than 3 non-collinear points with confidence: the twist is zero.
    INVALID_INPUT = 4  # The gripper pose is not finite: the twist is zero.
    HOLDING = 5  # There is no reference to follow now: the twist is zero.


class IkStatus(IntEnum):
    """Of `DifferentialIk`."""

    OK = 0
    LIMITED = 1  # The twist asked for is followed at reduced speed.
    STUCK = 2  # It cannot be followed at all: joint limit or singularity.
    INVALID_INPUT = 3  # An input is not finite; the arm is brought to rest.


class RobotMode(IntEnum):
    """Of the robot, as numbered in Drake's `lcmt_panda_status`."""

    OTHER = 0
    IDLE = 1
    MOVE = 2
    GUIDING = 3
    REFLEX = 4
    USER_STOPPED = 5
    AUTOMATIC_ERROR_RECOVERY = 6
