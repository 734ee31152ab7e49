"""The phases and faults of the skill."""

from poil_drake.systems.statuses import DescribedEnum


class Phase(DescribedEnum):
    """A phase of the skill. Its `text` says why it begins. The phases up to DONE run in order."""

    WAIT = 0, "the run has begun"
    APPROACH = 1, "the tracker follows the object"
    DESCEND = 2, "the approach has ended"
    GRASP = 3, "the descent has ended"
    LIFT = 4, "the fingers stand still around the object"
    FOLLOW = 5, "the object is lifted"
    RELEASE = 6, "the points are at the reference's end, or as close as they get"
    RETREAT = 7, "the fingers have had time to open"
    SETTLE = 8, "the gripper has backed off"
    DONE = 9, "the object has had time to settle"
    FAULT = 10, "the skill ended early"


HOLDING = frozenset({Phase.LIFT, Phase.FOLLOW})
"""Phases in which the object moves with the gripper."""

TWIST_PHASES = frozenset({Phase.LIFT, Phase.FOLLOW, Phase.RETREAT})
"""Phases in which the arm follows a twist."""

PHASE_NAMES = tuple(phase.name.lower() for phase in Phase)
"""The phases' names, by index."""


class Fault(DescribedEnum):
    """Why the skill ended early; `text` is a clause for reports."""

    NONE = 0, "no fault"
    TRACKING_LOST = 1, "the tracker lost the object and did not find it again"
    GRASP_MISSED = 2, "the fingers closed on nothing"
    OBJECT_DROPPED = 3, "the object slipped out of the fingers"
    NO_PROGRESS = 4, "the points stopped short of the reference's end"
    IK_STUCK = 5, "the arm could not follow the desired twist (joint limit or singularity)"
    HAND_STATUS = 6, "the hand stopped reporting its opening"
    TIMEOUT = 7, "a phase took longer than allowed"
    SAFETY = 8, "the safety supervisor stopped the arm"
    HAND_IDLE = 9, "the hand did not close on command"


def phase_reason(phase: int, fault: int) -> str:
    """Returns a clause on why a phase begins.

    Args:
        phase: A `Phase`, e.g. as read from a port.
        fault: The `Fault` that is reported with the phase.
    """
    return Fault(fault).text if phase == Phase.FAULT else Phase(phase).text
