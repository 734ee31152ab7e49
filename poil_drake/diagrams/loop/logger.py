"""The closed loop's logger: which signals it logs, and the text of each status."""

from collections.abc import Mapping
from enum import IntEnum

from pydrake.multibody.tree import BodyIndex

from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station import Station
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.recording.run_log.writer import RunLogWriter
from poil_drake.robots.panda import ARM_JOINTS
from poil_drake.systems.logging.mcap_logger import McapLogger
from poil_drake.systems.safety.faults import SafetyFault
from poil_drake.systems.skill.phases import PHASE_NAMES, Fault, phase_reason
from poil_drake.systems.statuses import ControllerStatus, DetectorStatus, IkStatus, TrackerStatus

_STATUSES = {
    "controller": ("status", "tau", "potential", "mean_error", "goal_error"),
    "ik": ("status", "scale"),
    "tracker": ("status", "age"),
    "detector": ("status",),
    "supervisor": ("fault", "scale"),
    "skill": ("fault", "holding", "detect_request"),
    "hand": ("width_commanded", "width_measured"),
}


def MakeLoopLogger(
    scenario: Scenario, plan: ExecutionPlan, *, log: RunLogWriter, station: Station
) -> McapLogger:
    """Returns the logger of a closed loop, with the ports that `OPTIONAL_WIRES` names.

    Args:
        scenario: The station and the task.
        plan: The plan that the loop executes.
        log: Receives the messages.
        station: Has the bodies that may be pushed, and the cameras whose times are logged.
    """
    plant = station.plant()
    period, offset = RobotLogSchedule(scenario)
    bodies = [plant.get_body(BodyIndex(i)) for i in range(plant.num_bodies())]
    return McapLogger(
        log=log,
        num_points=len(plan.target_points),
        joint_names=ARM_JOINTS,
        phase_names=PHASE_NAMES,
        phase_reason=phase_reason,
        body_names=[body.scoped_name().get_full() for body in bodies],
        statuses=_STATUSES | {"cameras": [f"{name}.image_time" for name in station.camera_names]},
        texts={
            "controller.status": _names(ControllerStatus),
            "ik.status": _names(IkStatus),
            "tracker.status": _names(TrackerStatus),
            "detector.status": _names(DetectorStatus),
            "supervisor.fault": {int(fault): fault.text for fault in SafetyFault},
            "skill.fault": {int(fault): fault.text for fault in Fault},
        },
        reference=plan.reference,
        period=scenario.poil.rates.logger,
        robot_period=period,
        robot_offset=offset,
    )


def RobotLogSchedule(scenario: Scenario) -> tuple[float, float]:
    """Returns the period and the offset [s] at which the robot's signals are logged.

    Samples are logged one plant step after the start of each control period. They hold the values
    that the control systems read at the start: the plant steps first, and its outputs then stay
    the same until its next step.
    """
    rates = scenario.poil.rates
    return rates.control, 0.0 if rates.plant == rates.control else rates.plant


def _names(statuses: type[IntEnum]) -> Mapping[int, str]:
    return {int(status): status.name.lower() for status in statuses}
