"""Adds the perception of the closed loop: the part detector and the point tracker."""

from dataclasses import replace

import numpy as np
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from scipy.spatial import cKDTree

from poil_drake.diagrams.scenario.poil_config import PoilConfig
from poil_drake.diagrams.scenario.scenario import GROUND_TRUTH
from poil_drake.diagrams.station.station import Station
from poil_drake.errors import InvalidValueError, ScenarioError
from poil_drake.geometry.pca_normals import pca_normals
from poil_drake.geometry.point_cloud import PointCloud
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.perception.detectors.known_shape.detector import KnownShapeDetector
from poil_drake.perception.detectors.known_shape.shape_fit import KnownShape
from poil_drake.perception.detectors.protocol import Detector
from poil_drake.perception.detectors.registry import (
    BY_HAND,
    DEMONSTRATION,
    LABEL_IMAGE,
    make_detector,
)
from poil_drake.perception.trackers.learned.config import MvTrackerConfig
from poil_drake.perception.trackers.process_tracker import ProcessTracker
from poil_drake.perception.trackers.protocol import Tracker
from poil_drake.perception.trackers.registry import TRACKERS, make_tracker
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.detection.part_detector import PartDetector
from poil_drake.systems.tracking.point_tracker import PointTracker

_SOONEST = 0.9
"""Least time between tracked images, in tracker periods; below 1 because cameras jitter."""

_DEFAULT_TRACKER = "rigid_flow"
"""The tracker for demonstrations if `poil.tracker` is the ground-truth baseline."""


def AddPerception(
    *,
    builder: DiagramBuilder,
    plan: ExecutionPlan,
    station: Station,
    dry_run: bool,
    stopwatch: Stopwatch | None,
) -> dict[str, LeafSystem]:
    """Adds detector and tracker, and returns them by name.

    Args:
        builder: Receives the systems.
        plan: Has the points to track.
        station: Has the cameras and the scenario, which names the detector and the tracker, and
            sets when images are captured and results are released.
        dry_run: Whether to stop tracking once the points are found, as in a dry run.
        stopwatch: Measures the time for captures, detection and tracking.

    Raises:
        ScenarioError: if there are no cameras.
        InvalidValueError: if `poil.detector` or `poil.tracker` is not a known name.
    """
    poil = station.scenario.poil
    cameras = station.camera_models
    if not cameras:
        raise ScenarioError(
            f"The tracker '{poil.tracker}' needs cameras, but the scenario has none.",
            remedy=f"Define cameras, or set poil.tracker to {GROUND_TRUTH}.",
        )
    detector = PartDetector(
        detector=MakeRunDetector(poil, plan),
        cameras=cameras,
        object_label=poil.object,
        part_label=poil.part,
        timing=station.detector_timing,
        label_ids=station.label_ids if poil.detector == LABEL_IMAGE else None,
        robot=PandaModel(X_WB=station.robot_base_pose().GetAsMatrix4()),
        stopwatch=stopwatch,
    )
    tracker = PointTracker(
        tracker=ProcessTracker(MakeScenarioTracker(poil)),
        cameras=cameras,
        num_points=len(plan.target_points),
        query_points=plan.target_points,
        timing=station.tracker_timing,
        min_interval=_SOONEST * poil.rates.tracker,
        once=dry_run,
        stopwatch=stopwatch,
    )
    return {
        "detector": builder.AddNamedSystem("detector", detector),
        "tracker": builder.AddNamedSystem("tracker", tracker),
    }


def MakeRunDetector(poil: PoilConfig, plan: ExecutionPlan) -> Detector:
    """Returns the detector that finds a plan's object at the start of a run and during it.

    Where the demonstration or a person showed the object, it is searched by its shape in the plan.

    Raises:
        InvalidValueError: if `poil.detector` is not a known name.
        MissingDependencyError: if a model that it needs is missing.
    """
    if poil.detector not in (DEMONSTRATION, BY_HAND):
        return make_detector(poil.detector, poil.detector_config, table_height=poil.table_height)
    points = plan.object_points
    cloud = PointCloud(points, pca_normals(points, np.arange(len(points))))
    # The object's cloud is coarser than the part's, so its points lie beside the part's.
    to_part = cKDTree(plan.part_points).query(points)[0]
    part = to_part <= max(poil.fusion.coarser().voxel_size, to_part.min())
    return KnownShapeDetector(
        KnownShape(cloud, part, np.zeros(len(points), dtype=bool)),
        table_height=poil.table_height,
        is_same=True,
    )


def MakeScenarioTracker(poil: PoilConfig) -> Tracker:
    """Returns the image-based tracker that a scenario selects.

    For the ground-truth baseline, which uses no images, returns the tracker `rigid_flow`.

    Raises:
        InvalidValueError: if `poil.tracker` is not a known name.
        MissingDependencyError: if the tracker needs weights or an environment that are missing.
    """
    name = _DEFAULT_TRACKER if poil.tracker == GROUND_TRUTH else poil.tracker
    if name not in TRACKERS:
        raise InvalidValueError(
            f"There is no point tracker '{name}'.",
            remedy=f"Choose one of: {', '.join([*TRACKERS, GROUND_TRUTH])}.",
        )
    config = getattr(poil.tracker_config, name)
    config = replace(config, support_points=poil.num_support_points)
    if isinstance(config, MvTrackerConfig):
        config = replace(config, table_height=poil.table_height)
    return make_tracker(name, config)
