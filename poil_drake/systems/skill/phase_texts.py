"""What phases are called in reports, and why each of them begins."""

from poil_drake.systems.skill.phases import FAULT_TEXT, Fault, Phase

PHASE_NAMES = tuple(phase.name.lower() for phase in Phase)
"""The phases' names, by index."""

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
    """Returns why a phase begins, in one clause.

    Args:
        phase: A `Phase`, e.g. as read from a port.
        fault: The `Fault` that is reported with it.
    """
    if phase == Phase.FAULT:
        return FAULT_TEXT[Fault(fault)]
    return _REASONS[Phase(phase)]
