"""What tells the closed loop where the points are: detector and tracker, or the ground truth."""

from pydrake.systems.framework import DiagramBuilder, LeafSystem

from poil_drake.diagrams.scenario import Scenario
from poil_drake.diagrams.scenario_checks import GROUND_TRUTH
from poil_drake.diagrams.scenario_tracker import MakeScenarioTracker
from poil_drake.diagrams.station import Station
from poil_drake.errors import ScenarioError
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.perception.detectors.registry import make_detector
from poil_drake.perception.trackers.process_tracker import ProcessTracker
from poil_drake.systems.ground_truth_tracker import (
    GroundTruthTracker,
    GroundTruthTrackerConfig,
)
from poil_drake.systems.part_detector import PartDetector
from poil_drake.systems.point_tracker import PointTracker, PointTrackerConfig
from poil_drake.systems.stopwatch import Stopwatch


def AddGroundTruthTracker(
    *, builder: DiagramBuilder, scenario: Scenario, plan: ExecutionPlan, station: Station
) -> GroundTruthTracker:
    """Adds the labelled baseline, which reads the simulator's own poses.

    Args:
        builder: Gets the tracker.
        scenario: Its times.
        plan: The points to follow.
        station: The simulator.
    """
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


def AddPerception(
    *,
    builder: DiagramBuilder,
    scenario: Scenario,
    plan: ExecutionPlan,
    station: Station,
    hardware: bool,
    stopwatch: Stopwatch | None,
) -> dict[str, LeafSystem]:
    """Adds detector and tracker, and returns them by name.

    Args:
        builder: Gets the systems.
        scenario: Their names and times.
        plan: The points to follow.
        station: The cameras.
        hardware: Whether results are not awaited, but late when they are late.
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
