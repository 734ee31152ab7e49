"""The closed loop: station, cameras, tracker, propagator, Point-set BCSDM, inverse kinematics."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem

from poil_drake.control.point_set_bcsdm import BcsdmConfig
from poil_drake.diagrams.closed_loop_logger import MakeLoopLogger
from poil_drake.diagrams.closed_loop_wires import (
    DETECTOR_LOGGER_WIRES,
    GROUND_TRUTH_WIRES,
    LOGGER_WIRES,
    LOOP_WIRES,
    PERCEPTION_WIRES,
    SNAPSHOT_WIRES,
    VISUALIZER_WIRES,
)
from poil_drake.diagrams.scenario import Scenario
from poil_drake.diagrams.scenario_checks import GROUND_TRUTH
from poil_drake.diagrams.scenario_tracker import MakeScenarioTracker
from poil_drake.diagrams.station import MakeStation, Station
from poil_drake.errors import ScenarioError
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.perception.detectors.registry import make_detector
from poil_drake.perception.trackers.process_tracker import ProcessTracker
from poil_drake.recording.run_log import RunLogWriter
from poil_drake.systems.arm_plant import MakePandaKinematics
from poil_drake.systems.differential_ik import DifferentialIk, DifferentialIkConfig
from poil_drake.systems.disturbance_injector import DisturbanceInjector, Pulse
from poil_drake.systems.fk_propagator import FkPropagator
from poil_drake.systems.ground_truth_tracker import (
    GroundTruthTracker,
    GroundTruthTrackerConfig,
)
from poil_drake.systems.motion_source import MotionSource, MotionSourceConfig
from poil_drake.systems.part_detector import PartDetector
from poil_drake.systems.phase_texts import PHASE_NAMES
from poil_drake.systems.point_set_bcsdm import PointSetBcsdm, PointSetBcsdmConfig
from poil_drake.systems.point_set_visualizer import (
    PointSetVisualizer,
    PointSetVisualizerConfig,
)
from poil_drake.systems.point_tracker import PointTracker, PointTrackerConfig
from poil_drake.systems.publishing_clock import PublishingClock
from poil_drake.systems.skill_phases import SkillConfig
from poil_drake.systems.skill_sequencer import SkillSequencer
from poil_drake.systems.snapshot_recorder import SnapshotAlbum, SnapshotRecorder
from poil_drake.systems.stopwatch import Stopwatch


@dataclass(frozen=True, kw_only=True)
class ClosedLoop:
    """The closed loop and its named parts.

    With a tracker of images, processes work beside the simulation: `Close` it after the run, or use
    it as a `with` block.

    Attributes:
        diagram: The whole, ready for a Simulator.
        station: The robot and its surroundings.
        detector: Finds the part; None with the ground-truth tracker.
        tracker: `PointTracker` or `GroundTruthTracker`.
        propagator: Brings the tracked points up to now.
        controller: Point-set BCSDM.
        inverse_kinematics: From the gripper's twist to joint velocities.
        sequencer: The skill's phases.
        motion: What moves the arm in each phase.
    """

    diagram: Diagram
    station: Station
    detector: PartDetector | None
    tracker: PointTracker | GroundTruthTracker
    propagator: FkPropagator
    controller: PointSetBcsdm
    inverse_kinematics: DifferentialIk
    sequencer: SkillSequencer
    motion: MotionSource

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.Close()

    def Close(self) -> None:
        """Ends the tracker's and the cameras' processes. Nothing can be simulated after that."""
        _close(self.station, self.tracker)


def MakeClosedLoop(
    scenario: Scenario,
    plan: ExecutionPlan,
    *,
    meshcat: Meshcat | None = None,
    hardware: bool = False,
    log: RunLogWriter | None = None,
    album: SnapshotAlbum | None = None,
    disturbances: Sequence[Pulse] = (),
    stopwatch: Stopwatch | None = None,
) -> ClosedLoop:
    """Builds the diagram that executes a plan, and starts the processes that work beside it.

    Args:
        scenario: The station and the task.
        plan: What `transfer` and grasp selection found.
        meshcat: Shows the scene, the points and the reference there.
        hardware: Whether the station is the real robot.
        log: Where to log every signal and the images. Whoever opened it closes it after the run.
        album: Where to keep pictures of the run.
        disturbances: Pushes on bodies of the simulated plant.
        stopwatch: Where to note how long rendering, tracking, control and publishing take.

    Returns:
        The loop, which is to be closed after the run.

    Raises:
        PoilError: if the station, the detector or the tracker cannot be built.
    """
    builder = DiagramBuilder()
    truth = scenario.poil.tracker == GROUND_TRUTH
    schedules = _publish_schedules(scenario, meshcat=meshcat is not None, album=album is not None)
    clock = PublishingClock(stopwatch or Stopwatch(), schedules)
    clock.AddStart(builder)
    station = builder.AddNamedSystem(
        "station",
        MakeStation(
            scenario,
            meshcat=meshcat,
            hardware=hardware,
            cameras=not truth,
            stopwatch=stopwatch,
        ),
    )
    parts: dict[str, Any] = {"station": station}
    try:
        station.StartCameras()
        parts |= _add_control(builder, station, plan, stopwatch)
        if truth:
            parts["tracker"] = _add_ground_truth_tracker(builder, scenario, plan, station)
        else:
            parts |= _add_perception(builder, scenario, plan, station, hardware, stopwatch)
        parts |= _add_onlookers(builder, scenario, plan, station, meshcat, log, album)
        _connect_by_name(builder, parts)
        _add_disturbances(builder, disturbances, parts)
        clock.AddStop(builder)
        diagram = builder.Build()
        station.WarmUpCameras()
    except BaseException:
        _close(station, parts.get("tracker"))
        raise
    return ClosedLoop(
        diagram=diagram,
        station=station,
        detector=parts.get("detector"),
        tracker=parts["tracker"],
        propagator=parts["propagator"],
        controller=parts["controller"],
        inverse_kinematics=parts["inverse_kinematics"],
        sequencer=parts["sequencer"],
        motion=parts["motion"],
    )


def _close(station: Station, tracker: LeafSystem | None) -> None:
    try:
        if isinstance(tracker, PointTracker):
            tracker.close()
    finally:
        station.Close()


def _add_onlookers(
    builder: DiagramBuilder,
    scenario: Scenario,
    plan: ExecutionPlan,
    station: Station,
    meshcat: Meshcat | None,
    log: RunLogWriter | None,
    album: SnapshotAlbum | None,
) -> dict[str, LeafSystem]:
    """Adds what shows and records the run; nothing in the loop depends on it."""
    parts: dict[str, LeafSystem] = {}
    if meshcat is not None:
        parts["visualizer"] = _add_visualizer(builder, scenario, plan, meshcat)
    if log is not None:
        parts["logger"] = builder.AddNamedSystem(
            "logger", MakeLoopLogger(scenario, plan, log=log, station=station)
        )
    if album is not None and scenario.poil.tracker != GROUND_TRUTH:
        parts["snapshots"] = builder.AddNamedSystem(
            "snapshots",
            SnapshotRecorder(
                album=album,
                camera=station.camera_models[0],
                reference=plan.reference,
                period=scenario.poil.rates.tracker,
                offset=scenario.poil.rates.control,
            ),
        )
    return parts


def _add_disturbances(
    builder: DiagramBuilder, pulses: Sequence[Pulse], parts: dict[str, Any]
) -> None:
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


def _add_control(
    builder: DiagramBuilder,
    station: Station,
    plan: ExecutionPlan,
    stopwatch: Stopwatch | None,
) -> dict[str, LeafSystem]:
    poil = station.scenario.poil
    period = poil.rates.control
    X_WB = station.robot_base_pose()
    kinematics = MakePandaKinematics(X_WB)
    ik = DifferentialIkConfig()
    ik = replace(ik, resolution=replace(ik.resolution, nominal_posture=tuple(plan.nominal_posture)))
    systems = {
        "propagator": FkPropagator(
            num_points=len(plan.target_points),
            kinematics=kinematics,
            period=period,
            max_age=_MISSED_TRACKS * poil.rates.tracker + poil.latency,
            stopwatch=stopwatch,
        ),
        "controller": PointSetBcsdm(
            reference=plan.reference,
            period=period,
            config=PointSetBcsdmConfig(
                bcsdm=BcsdmConfig(eta=poil.eta),
                max_angular_speed=poil.max_angular_speed,
                max_linear_speed=poil.max_linear_speed,
                **_workspace(X_WB.translation(), poil.table_height),
            ),
        ),
        "inverse_kinematics": DifferentialIk(
            kinematics=kinematics, period=period, config=ik, stopwatch=stopwatch
        ),
        "sequencer": SkillSequencer(
            config=SkillConfig(
                pregrasp_width=plan.pregrasp_width, release_width=plan.pregrasp_width
            ),
            period=period,
            stopwatch=stopwatch,
        ),
        "motion": MotionSource(
            approach=plan.approach,
            descent=plan.descent,
            config=MotionSourceConfig(
                lift_distance=plan.lift_height, retreat_distance=plan.retreat_distance
            ),
            period=period,
        ),
    }
    for name, system in systems.items():
        builder.AddNamedSystem(name, system)
    return systems


def _workspace(p_WB: np.ndarray, table_height: float) -> dict[str, tuple[float, float, float]]:
    """Returns the box in which points are believed, for a robot whose base is at p_WB (3,) [m].

    The Panda reaches 0.855 m, and what it holds somewhat further.
    """
    x, y, z = p_WB.tolist()
    return {
        "workspace_lower": (x - 1.0, y - 1.0, table_height - 0.05),
        "workspace_upper": (x + 1.0, y + 1.0, z + 1.3),
    }


def _add_ground_truth_tracker(
    builder: DiagramBuilder, scenario: Scenario, plan: ExecutionPlan, station: Station
) -> GroundTruthTracker:
    poil = scenario.poil
    return builder.AddNamedSystem(
        "tracker",
        GroundTruthTracker(
            body_index=station.object_body().index(),
            num_points=len(plan.target_points),
            query_points=plan.target_points,
            config=GroundTruthTrackerConfig(period=poil.rates.tracker, latency=poil.latency),
        ),
    )


def _add_perception(
    builder: DiagramBuilder,
    scenario: Scenario,
    plan: ExecutionPlan,
    station: Station,
    hardware: bool,
    stopwatch: Stopwatch | None,
) -> dict[str, LeafSystem]:
    poil = scenario.poil
    cameras = station.camera_models
    if not cameras:
        raise ScenarioError(
            f"The tracker '{poil.tracker}' looks through cameras, but the scenario names none.",
            remedy=f"Name cameras, or set poil.tracker to {GROUND_TRUTH}.",
        )
    # Images that appear at one instant can be looked at from the next control period on.
    delay = station.camera_delay + poil.rates.control if station.camera_delay > 0.0 else 0.0
    detector = PartDetector(
        detector=make_detector(poil.detector),
        cameras=cameras,
        object_label=poil.object,
        part_label=poil.part,
        period=poil.rates.tracker,
        offset=delay,
        label_ids=station.label_ids,
        stopwatch=stopwatch,
    )
    tracker = PointTracker(
        tracker=ProcessTracker(MakeScenarioTracker(poil)),
        cameras=cameras,
        num_points=len(plan.target_points),
        query_points=plan.target_points,
        config=PointTrackerConfig(
            period=poil.rates.tracker,
            offset=delay,
            latency=max(poil.latency - delay, 0.0),  # as written in decimals
            blocking=not hardware,
        ),
        stopwatch=stopwatch,
    )
    return {
        "detector": builder.AddNamedSystem("detector", detector),
        "tracker": builder.AddNamedSystem("tracker", tracker),
    }


def _add_visualizer(
    builder: DiagramBuilder, scenario: Scenario, plan: ExecutionPlan, meshcat: Meshcat
) -> PointSetVisualizer:
    config = PointSetVisualizerConfig(period=scenario.poil.rates.logger)
    return builder.AddNamedSystem(
        "visualizer",
        PointSetVisualizer(
            meshcat=meshcat, reference=plan.reference, phase_names=PHASE_NAMES, config=config
        ),
    )


def _publish_schedules(
    scenario: Scenario, *, meshcat: bool, album: bool
) -> list[tuple[float, float]]:
    """Returns the periods and offsets [s] at which anything in the loop publishes."""
    rates = scenario.poil.rates
    schedules = [(rates.logger, 0.0)]
    if meshcat:
        schedules.append((scenario.visualization.publish_period, 0.0))
    if album:
        schedules.append((rates.tracker, rates.control))
    return schedules


_MISSED_TRACKS = 4
"""Points are carried along by forward kinematics for so many tracker periods."""


def _connect_by_name(builder: DiagramBuilder, parts: dict[str, LeafSystem | Station]) -> None:
    wires = list(LOOP_WIRES)
    if "detector" in parts:
        wires += PERCEPTION_WIRES
        for camera in parts["station"].camera_names:
            for image in ("rgb_image", "depth_image", "image_time"):
                port = f"{camera}.{image}"
                wires.append((f"station.{port}", f"tracker.{port}"))
                wires.append((f"station.{port}", f"detector.{port}"))
            wires.append((f"station.{camera}.label_image", f"detector.{camera}.label_image"))
        first = parts["station"].camera_names[0]
        wires.append((f"station.{first}.image_time", "propagator.image_time"))
    else:
        wires += GROUND_TRUTH_WIRES
    if "visualizer" in parts:
        wires += VISUALIZER_WIRES
    if "logger" in parts:
        wires += LOGGER_WIRES
        if "detector" in parts:
            wires += DETECTOR_LOGGER_WIRES
    if "snapshots" in parts:
        wires += SNAPSHOT_WIRES
    robot = parts["station"].scenario.poil.robot
    for source, target in wires:
        source, target = (
            end.replace("station.panda.", f"station.{robot}.") for end in (source, target)
        )
        (giver, output), (taker, input_) = source.split(".", 1), target.split(".", 1)
        builder.Connect(parts[giver].GetOutputPort(output), parts[taker].GetInputPort(input_))
