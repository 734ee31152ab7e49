"""The closed loop: station, cameras, tracker, propagator, Point-set BCSDM, inverse kinematics."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Self

from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem

from poil_drake.diagrams.loop.control import AddControl
from poil_drake.diagrams.loop.logging_and_visualization import (
    AddLoggingAndVisualization,
    PublishSchedules,
)
from poil_drake.diagrams.loop.perception import AddPerception
from poil_drake.diagrams.loop.wires import ConnectByName
from poil_drake.diagrams.scenario.scenario import GROUND_TRUTH, Scenario
from poil_drake.diagrams.station.station import (
    MakeStation,
    RequireLabels,
    SimulatedStation,
    Station,
)
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.recording.run_log.writer import RunLogWriter
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.control.motion_source import MotionSource
from poil_drake.systems.control.point_set_bcsdm import PointSetBcsdm
from poil_drake.systems.detection.part_detector import PartDetector
from poil_drake.systems.disturbance_injector import DisturbanceInjector, Pulse
from poil_drake.systems.fk_propagator import FkPropagator
from poil_drake.systems.ik.differential_ik import DifferentialInverseKinematics
from poil_drake.systems.logging.publishing_clock import PublishingClock
from poil_drake.systems.logging.snapshot_recorder import SnapshotAlbum
from poil_drake.systems.safety.supervisor import SafetySupervisor
from poil_drake.systems.skill.sequencer import SkillSequencer
from poil_drake.systems.skill.stop_requests import StopRequests, StopSwitch
from poil_drake.systems.tracking.point_tracker import PointTracker


@dataclass(frozen=True, kw_only=True)
class ClosedLoop:
    """The closed loop and its named parts.

    With an image-based tracker, other processes run beside the simulation, so `Close` the loop
    after the run, or use it in a `with` statement.

    Attributes:
        diagram: The whole diagram, ready for a Simulator.
        station: The robot and its surroundings.
        detector: Finds the part; None if the tracker needs no detector.
        tracker: `PointTracker`, `GroundTruthTracker`, `RecordedTracker` (replay), or the user's.
        propagator: Propagates the tracked points to the present.
        controller: Point-set BCSDM: computes the gripper's twist from the points.
        inverse_kinematics: Turns the gripper's twist into joint velocities.
        sequencer: The skill's phases.
        motion: Selects the arm's motion in each phase.
        supervisor: Checks and limits every command to the robot.
        stop_requests: Counts requests to stop the arm.
        speed: Factor on the speed of all motions.
    """

    diagram: Diagram
    station: Station
    detector: PartDetector | None = None
    tracker: LeafSystem
    propagator: FkPropagator
    controller: PointSetBcsdm
    inverse_kinematics: DifferentialInverseKinematics
    sequencer: SkillSequencer
    motion: MotionSource
    supervisor: SafetySupervisor
    stop_requests: StopRequests
    speed: float = 1.0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.Close()

    def Close(self) -> None:
        """Ends the threads and processes beside the loop. Do not use the loop afterwards."""
        _close(self.station, self.tracker, self.detector)
        self.stop_requests.close()


def MakeClosedLoop(
    scenario: Scenario,
    plan: ExecutionPlan,
    *,
    station: Station | None = None,
    tracker: LeafSystem | None = None,
    meshcat: Meshcat | None = None,
    hardware: bool = False,
    dry_run: bool = False,
    log: RunLogWriter | None = None,
    album: SnapshotAlbum | None = None,
    disturbances: Sequence[Pulse] = (),
    stop_switch: StopSwitch | None = None,
    stopwatch: Stopwatch | None = None,
) -> ClosedLoop:
    """Builds the diagram that executes a plan, and starts the processes that run beside it.

    Args:
        scenario: The station and the task.
        plan: The result of transfer and grasp selection.
        station: The robot and its surroundings; None builds the scenario's.
        tracker: A system that replaces the scenario's detector and tracker; None keeps them. It
            needs the output ports of `PointTracker`, except `frame`. It may have the input ports
            `body_poses` (in simulation), `object_motion`, and `<camera>.rgb_image`, `.depth_image`,
            `.rgbd_image`, `.label_image` and `.image_time`, which are then connected.
            `object_motion` is the object's motion at the images' time, or at present if the tracker
            takes no images.
        meshcat: Where to show the scene, the points and the reference; None shows nothing.
        hardware: Whether the station is the real robot.
        dry_run: On hardware: whether to only show the motion, from the measured state of the robot
            and the object, and to send nothing to the robot.
        log: Receives every signal and the images; the caller closes it after the run.
        album: Receives pictures of the run, if the tracker has the output port `frame`.
        disturbances: Pushes on bodies of the simulated plant, besides the scenario's.
        stop_switch: Stops the arm on request, like the button on the page of `meshcat`.
        stopwatch: Measures the time for rendering, tracking, control and publishing.

    Returns:
        The loop. Close it after the run.

    Raises:
        PoilError: if the station, the detector or the tracker cannot be built.
    """
    builder = DiagramBuilder()
    speed = scenario.poil.hardware.speed if hardware else 1.0
    schedules = PublishSchedules(
        scenario, log=log is not None, meshcat=meshcat is not None, album=album is not None
    )
    clock = PublishingClock(stopwatch or Stopwatch(), schedules)
    clock.AddStart(builder)
    if station is None:
        station = MakeStation(
            scenario,
            meshcat=meshcat,
            hardware=hardware,
            dry_run=dry_run,
            cameras=scenario.poil.tracker != GROUND_TRUTH,
            stopwatch=stopwatch,
        )
    builder.AddNamedSystem("station", station)
    parts: dict[str, Any] = {"station": station}
    given: dict[str, Any] = {"builder": builder, "plan": plan, "station": station}
    try:
        if tracker is None:
            tracker = station.MakeImagelessTracker(plan)
        if tracker is None:
            RequireLabels(station)
        station.Start()
        parts |= AddControl(
            **given,
            speed=speed,
            hardware=hardware,
            dry_run=dry_run,
            meshcat=meshcat,
            stop_switch=stop_switch,
            stopwatch=stopwatch,
        )
        if tracker is not None:
            parts["tracker"] = builder.AddNamedSystem("tracker", tracker)
        else:
            parts |= AddPerception(**given, dry_run=dry_run, stopwatch=stopwatch)
        shown = album if parts["tracker"].HasOutputPort("frame") else None
        parts |= AddLoggingAndVisualization(**given, meshcat=meshcat, log=log, album=shown)
        if isinstance(station, SimulatedStation):
            disturbances = (*scenario.poil.disturbances, *disturbances)
        if disturbances:
            injector = DisturbanceInjector(plant=station.plant(), pulses=disturbances)
            parts["disturbances"] = builder.AddNamedSystem("disturbances", injector)
        ConnectByName(builder, parts)
        clock.AddStop(builder)
        diagram = builder.Build()
        station.WarmUp()
    except BaseException:
        _close(station, parts.get("tracker"), parts.get("detector"))
        raise
    named = {f.name: parts[f.name] for f in fields(ClosedLoop) if f.name in parts}
    return ClosedLoop(diagram=diagram, speed=speed, **named)


def _close(station: Station, tracker: LeafSystem | None, detector: PartDetector | None) -> None:
    try:
        # The robot comes first.
        station.Close()
    finally:
        if detector is not None:
            detector.close()
        if isinstance(tracker, PointTracker):
            tracker.close()
