"""Adds the systems that log, show and disturb a run of the closed loop."""

from collections.abc import Mapping, Sequence
from typing import Any

from pydrake.geometry import Meshcat
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from poil_drake.diagrams.loop.logger import MakeLoopLogger, RobotLogSchedule
from poil_drake.diagrams.scenario.scenario import GROUND_TRUTH, Scenario
from poil_drake.diagrams.station.station import Station
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.recording.run_log.writer import RunLogWriter
from poil_drake.systems.disturbance_injector import DisturbanceInjector, Pulse
from poil_drake.systems.logging.snapshot_recorder import SnapshotAlbum, SnapshotRecorder
from poil_drake.systems.skill.phases import PHASE_NAMES
from poil_drake.systems.visualization.point_set_visualizer import (
    PointSetVisualizer,
    PointSetVisualizerConfig,
)


def AddLoggingAndVisualization(
    *,
    builder: DiagramBuilder,
    scenario: Scenario,
    plan: ExecutionPlan,
    station: Station,
    meshcat: Meshcat | None,
    log: RunLogWriter | None,
    album: SnapshotAlbum | None,
) -> dict[str, LeafSystem]:
    """Adds the visualizer, the logger and the snapshot recorder, and returns them by name.

    Args:
        builder: Receives the systems.
        scenario: The station and the task.
        plan: The plan that the loop executes.
        station: The robot and its surroundings.
        meshcat: Where to show the run; None adds no visualizer.
        log: Receives the signals; None adds no logger.
        album: Receives snapshots. With None or the ground-truth tracker, no recorder is added.
    """
    systems: dict[str, LeafSystem] = {}
    if meshcat is not None:
        systems["visualizer"] = PointSetVisualizer(
            meshcat=meshcat,
            reference=plan.reference,
            phase_names=PHASE_NAMES,
            config=PointSetVisualizerConfig(period=scenario.poil.rates.logger),
        )
    if log is not None:
        systems["logger"] = MakeLoopLogger(scenario, plan, log=log, station=station)
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


def AddDisturbances(
    *, builder: DiagramBuilder, pulses: Sequence[Pulse], parts: Mapping[str, Any]
) -> None:
    """Adds pushes on bodies of the simulated plant, and logs them if there is a logger.

    Args:
        builder: Receives a `DisturbanceInjector`, if there are any pushes.
        pulses: The pushes.
        parts: The loop's parts by name.
    """
    if not pulses:
        return
    injector = builder.AddNamedSystem(
        "disturbances", DisturbanceInjector(plant=parts["station"].plant(), pulses=pulses)
    )
    for taker in ("station", "logger"):
        if taker in parts:
            builder.Connect(
                injector.get_output_port(0), parts[taker].GetInputPort("applied_spatial_force")
            )


def PublishSchedules(
    scenario: Scenario, *, log: bool, meshcat: bool, album: bool
) -> list[tuple[float, float]]:
    """Returns the periods and offsets [s] at which a loop with these outputs publishes."""
    rates = scenario.poil.rates
    schedules = [(rates.logger, 0.0)]
    if log:
        schedules.append(RobotLogSchedule(scenario))
    if meshcat:
        schedules.append((scenario.visualization.publish_period, 0.0))
    if album:
        schedules.append((rates.tracker, rates.control))
    return schedules
