"""What tells the closed loop where the points are: detector and tracker, or the ground truth."""

from collections.abc import Sequence

from pydrake.systems.framework import DiagramBuilder, LeafSystem

from poil_drake.diagrams.loop.scenario_tracker import MakeScenarioTracker
from poil_drake.diagrams.scenario.checks import GROUND_TRUTH
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.hardware_checks import ground_truth_error
from poil_drake.diagrams.station.hardware_schedule import IMAGES_SHARE
from poil_drake.diagrams.station.station import SimulatedStation, Station
from poil_drake.errors import ScenarioError
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.perception.detectors.registry import make_detector
from poil_drake.perception.trackers.process_tracker import ProcessTracker
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.detection.part_detector import PartDetector
from poil_drake.systems.tracking.ground_truth_tracker import (
    GroundTruthTracker,
    GroundTruthTrackerConfig,
)
from poil_drake.systems.tracking.point_tracker import PointTracker, PointTrackerConfig
from poil_drake.systems.tracking.recorded_tracker import RecordedTrack, RecordedTracker

_SOONEST = 0.9
"""Images that come this share of the tracker's period after the last are tracked: cameras are not
that punctual."""


def AddGroundTruthTracker(
    *, builder: DiagramBuilder, scenario: Scenario, plan: ExecutionPlan, station: Station
) -> GroundTruthTracker:
    """Adds the labelled baseline, which reads the simulator's own poses.

    Args:
        builder: Gets the tracker.
        scenario: Its times.
        plan: The points to follow.
        station: The simulator.

    Raises:
        ScenarioError: when it is the real robot, of which nobody knows the truth.
    """
    poil = scenario.poil
    if not isinstance(station, SimulatedStation):
        raise ground_truth_error()
    return builder.AddNamedSystem(
        "tracker",
        GroundTruthTracker(
            body_index=station.object_body().index(),
            num_points=len(plan.target_points),
            query_points=plan.target_points,
            config=GroundTruthTrackerConfig(period=poil.rates.tracker, latency=poil.latency),
        ),
    )


def AddRecordedTracker(
    *,
    builder: DiagramBuilder,
    scenario: Scenario,
    plan: ExecutionPlan,
    tracks: Sequence[RecordedTrack],
) -> RecordedTracker:
    """Adds what repeats the tracks of a run that is replayed.

    Args:
        builder: Gets the tracker.
        scenario: Its control period.
        plan: The points that are followed.
        tracks: What was said of them.
    """
    return builder.AddNamedSystem(
        "tracker",
        RecordedTracker(
            tracks=tracks,
            num_points=len(plan.target_points),
            period=scenario.poil.rates.control,
        ),
    )


def AddPerception(
    *,
    builder: DiagramBuilder,
    scenario: Scenario,
    plan: ExecutionPlan,
    station: Station,
    hardware: bool,
    dry_run: bool,
    stopwatch: Stopwatch | None,
) -> dict[str, LeafSystem]:
    """Adds detector and tracker, and returns them by name.

    Args:
        builder: Gets the systems.
        scenario: Their names and times.
        plan: The points to follow.
        station: The cameras.
        hardware: Whether results are not awaited, but late when they are late.
        dry_run: Whether the points are looked for only once, as the object will not really move.
        stopwatch: Where they note how long they take.

    Raises:
        ScenarioError: when there are no cameras.
        InvalidValueError: when there is no detector or tracker of that name.
    """
    poil = scenario.poil
    cameras = station.camera_models
    if not cameras:
        raise ScenarioError(
            f"The tracker '{poil.tracker}' looks through cameras, but the scenario names none.",
            remedy=f"Name cameras, or set poil.tracker to {GROUND_TRUTH}.",
        )
    # Images that appear at one instant can be looked at from the next control period on.
    delay = station.camera_delay + poil.rates.control if station.camera_delay > 0.0 else 0.0
    times = PointTrackerConfig(
        period=poil.rates.tracker,
        offset=delay,
        latency=max(poil.latency - delay, 0.0),  # as written in decimals
    )
    if hardware:
        # Images come when they come, and so do their tracks. They are looked at within a control
        # period, after its command has gone out; and in each other one, as the log, which takes as
        # long, is written in those between.
        delay = IMAGES_SHARE * poil.rates.control
        times = PointTrackerConfig(
            period=2.0 * poil.rates.control,
            offset=delay,
            latency=0.0,
            blocking=False,
            poll_period=poil.rates.control,
            min_interval=_SOONEST * poil.rates.tracker,
            once=dry_run,
        )
    detector_period, recorded = times.period, station.recorded
    if recorded is not None:
        # Looked at within the control periods in which they happened, when they did.
        delay = recorded.offset(poil.rates.control)
        detector_period = poil.rates.control
        times = PointTrackerConfig(
            period=poil.rates.control,
            offset=delay,
            latency=0.0,
            poll_period=poil.rates.control,
            recorded=recorded.tracking,
        )
    detector = PartDetector(
        detector=make_detector(poil.detector),
        cameras=cameras,
        object_label=poil.object,
        part_label=poil.part,
        period=detector_period,
        offset=delay,
        label_ids=station.label_ids,
        blocking=not hardware or recorded is not None,
        recorded=None if recorded is None else recorded.detection,
        stopwatch=stopwatch,
    )
    tracker = PointTracker(
        tracker=ProcessTracker(MakeScenarioTracker(poil)),
        cameras=cameras,
        num_points=len(plan.target_points),
        query_points=plan.target_points,
        config=times,
        stopwatch=stopwatch,
    )
    return {
        "detector": builder.AddNamedSystem("detector", detector),
        "tracker": builder.AddNamedSystem("tracker", tracker),
    }
