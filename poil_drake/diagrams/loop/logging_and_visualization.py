"""Adds the systems that log and show a run of the closed loop."""

from collections.abc import Mapping
from enum import IntEnum

from pydrake.geometry import Meshcat
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from poil_drake.diagrams.scenario.scenario import GROUND_TRUTH, Scenario
from poil_drake.diagrams.station.station import Station
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.recording.run_log.writer import RunLogWriter
from poil_drake.robots.panda import ARM_JOINTS
from poil_drake.systems.logging.mcap_logger import McapLogger
from poil_drake.systems.logging.snapshot_recorder import SnapshotAlbum, SnapshotRecorder
from poil_drake.systems.safety.faults import SafetyFault
from poil_drake.systems.skill.phases import PHASE_NAMES, Fault, phase_reason
from poil_drake.systems.statuses import ControllerStatus, DetectorStatus, IkStatus, TrackerStatus
from poil_drake.systems.visualization.point_set_visualizer import (
    PointSetVisualizer,
    PointSetVisualizerConfig,
)

_STATUSES = {
    "controller": ("status", "tau", "potential", "mean_error", "goal_error"),
    "ik": ("status", "scale"),
    "tracker": ("status", "age"),
    "detector": ("status",),
    "supervisor": ("fault", "scale"),
    "skill": ("fault", "holding", "detect_request"),
    "hand": ("width_commanded", "width_measured"),
}


def AddLoggingAndVisualization(
    *,
    builder: DiagramBuilder,
    plan: ExecutionPlan,
    station: Station,
    meshcat: Meshcat | None,
    log: RunLogWriter | None,
    album: SnapshotAlbum | None,
) -> dict[str, LeafSystem]:
    """Adds the systems that log and show a run, and returns them by name.

    Args:
        builder: Receives the systems.
        plan: The plan that the loop executes.
        station: The robot and its surroundings, with the scenario.
        meshcat: Where to show the run; None adds no visualizer.
        log: Receives the signals; None adds no logger.
        album: Receives snapshots. With None or the ground-truth tracker, no recorder is added.
    """
    scenario = station.scenario
    systems: dict[str, LeafSystem] = {}
    if meshcat is not None:
        systems["visualizer"] = PointSetVisualizer(
            meshcat=meshcat,
            reference=plan.reference,
            phase_names=PHASE_NAMES,
            config=PointSetVisualizerConfig(period=scenario.poil.rates.logger),
        )
    if log is not None:
        systems["logger"] = _make_logger(plan, log=log, station=station)
    if album is not None and scenario.poil.tracker != GROUND_TRUTH:
        systems["snapshots"] = SnapshotRecorder(
            album=album,
            camera=station.camera_models[0],
            reference=plan.reference,
            period=scenario.poil.rates.tracker,
            offset=scenario.poil.rates.control,
        )
    for name, system in systems.items():
        builder.AddNamedSystem(name, system)
    return systems


def _make_logger(plan: ExecutionPlan, *, log: RunLogWriter, station: Station) -> McapLogger:
    """Returns the logger of a closed loop, with the ports that `OPTIONAL_WIRES` names."""
    scenario, plant = station.scenario, station.plant()
    period, offset = _robot_log_schedule(scenario)
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


def _robot_log_schedule(scenario: Scenario) -> tuple[float, float]:
    """Returns the period and the offset [s] at which the robot's signals are logged.

    Samples are logged one plant step after the start of each control period. They hold the values
    that the control systems read at the start: the plant steps first, and its outputs then stay
    the same until its next step.
    """
    rates = scenario.poil.rates
    return rates.control, 0.0 if rates.plant == rates.control else rates.plant


def _names(statuses: type[IntEnum]) -> Mapping[int, str]:
    return {int(status): status.name.lower() for status in statuses}


def PublishSchedules(
    scenario: Scenario, *, log: bool, meshcat: bool, album: bool
) -> list[tuple[float, float]]:
    """Returns the periods and offsets [s] at which a loop with these outputs publishes."""
    rates = scenario.poil.rates
    schedules = [(rates.logger, 0.0)]
    if log:
        schedules.append(_robot_log_schedule(scenario))
    if meshcat:
        schedules.append((scenario.visualization.publish_period, 0.0))
    if album:
        schedules.append((rates.tracker, rates.control))
    return schedules
