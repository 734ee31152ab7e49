"""The closed loop: station, cameras, tracker, propagator, Point-set BCSDM, inverse kinematics."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem

from poil_drake.diagrams.closed_loop_control import AddControl
from poil_drake.diagrams.closed_loop_onlookers import (
    AddDisturbances,
    AddOnlookers,
    PublishSchedules,
)
from poil_drake.diagrams.closed_loop_perception import AddGroundTruthTracker, AddPerception
from poil_drake.diagrams.closed_loop_wires import ConnectByName
from poil_drake.diagrams.scenario import Scenario
from poil_drake.diagrams.scenario_checks import GROUND_TRUTH
from poil_drake.diagrams.station import MakeStation, Station
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.recording.run_log import RunLogWriter
from poil_drake.systems.differential_ik import DifferentialIk
from poil_drake.systems.disturbance_injector import Pulse
from poil_drake.systems.fk_propagator import FkPropagator
from poil_drake.systems.ground_truth_tracker import GroundTruthTracker
from poil_drake.systems.motion_source import MotionSource
from poil_drake.systems.part_detector import PartDetector
from poil_drake.systems.point_set_bcsdm import PointSetBcsdm
from poil_drake.systems.point_tracker import PointTracker
from poil_drake.systems.publishing_clock import PublishingClock
from poil_drake.systems.skill_sequencer import SkillSequencer
from poil_drake.systems.snapshot_recorder import SnapshotAlbum
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
    schedules = PublishSchedules(scenario, meshcat=meshcat is not None, album=album is not None)
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
    given: dict[str, Any] = {
        "builder": builder,
        "scenario": scenario,
        "plan": plan,
        "station": station,
    }
    try:
        station.StartCameras()
        parts |= AddControl(builder=builder, station=station, plan=plan, stopwatch=stopwatch)
        if truth:
            parts["tracker"] = AddGroundTruthTracker(**given)
        else:
            parts |= AddPerception(**given, hardware=hardware, stopwatch=stopwatch)
        parts |= AddOnlookers(**given, meshcat=meshcat, log=log, album=album)
        ConnectByName(builder, parts)
        AddDisturbances(builder=builder, pulses=disturbances, parts=parts)
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
