"""The phases and faults of the skill, and their descriptions in logs and reports."""

from enum import IntEnum


class Phase(IntEnum):
    """A phase of the skill; a phase that ends without a fault is followed by the next one."""

    WAIT = 0
    APPROACH = 1
    DESCEND = 2
    GRASP = 3
    LIFT = 4
    FOLLOW = 5
    RELEASE = 6
    RETREAT = 7
    SETTLE = 8
    DONE = 9
    FAULT = 10


HOLDING = frozenset({Phase.LIFT, Phase.FOLLOW})
"""Phases in which the object moves with the gripper."""

TWIST_PHASES = frozenset({Phase.LIFT, Phase.FOLLOW, Phase.RETREAT})
"""Phases in which the arm follows a twist."""

PHASE_NAMES = tuple(phase.name.lower() for phase in Phase)
"""The phases' names, by index."""


class Fault(IntEnum):
    """Why the skill ended early."""

    NONE = 0
    TRACKING_LOST = 1
    GRASP_MISSED = 2
    OBJECT_DROPPED = 3
    NO_PROGRESS = 4
    IK_STUCK = 5
    HAND_STATUS = 6
    TIMEOUT = 7
    SAFETY = 8
    HAND_IDLE = 9


FAULT_TEXT = {
    Fault.NONE: "no fault",
    Fault.TRACKING_LOST: "the tracker lost the object and did not find it again",
    Fault.GRASP_MISSED: "the fingers closed on nothing",
    Fault.OBJECT_DROPPED: "the object slipped out of the fingers",
    Fault.NO_PROGRESS: "the points stopped short of the reference",
    Fault.IK_STUCK: "the arm could not follow the asked twist (joint limit or singularity)",
    Fault.HAND_STATUS: "the hand stopped reporting its opening",
    Fault.TIMEOUT: "a phase took longer than allowed",
    Fault.SAFETY: "the safety supervisor stopped the arm",
    Fault.HAND_IDLE: "the hand did not close when it was told to",
}
"""A clause for each fault."""

_REASONS = {
    Phase.WAIT: "the run has begun",
    Phase.APPROACH: "the tracker follows the object",
    Phase.DESCEND: "the approach has ended",
    Phase.GRASP: "the descent has ended",
    Phase.LIFT: "the fingers stand still around the object",
    Phase.FOLLOW: "the object is lifted",
    Phase.RELEASE: "the points are at the reference's end, or as near as they come",
    Phase.RETREAT: "the fingers have had their time to open",
    Phase.SETTLE: "the gripper has backed off",
    Phase.DONE: "the object has had its time to settle",
}


def phase_reason(phase: int, fault: int) -> str:
    """Returns a clause on why a phase begins.

    Args:
        phase: A `Phase`, e.g. as read from a port.
        fault: The `Fault` that is reported with it.
    """
    return FAULT_TEXT[Fault(fault)] if phase == Phase.FAULT else _REASONS[Phase(phase)]
