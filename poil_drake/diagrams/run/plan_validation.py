"""Checks that a plan fits the scene in which it is executed."""

import numpy as np
from scipy.spatial import cKDTree

from poil_drake.diagrams.scenario.checks import GROUND_TRUTH
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station import CaptureFrame, MakeStation, Station
from poil_drake.errors import PlanningError
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.perception.detectors.registry import make_detector
from poil_drake.transfer.part_points import view_part

_JOINT_TOLERANCE = 0.01
"""Largest distance of a joint from the start of the approach [rad]. With the arm stretched out,
0.01 rad moves the hand by 1 cm, about the clearance that motions keep from obstacles."""

_SURFACE_TOLERANCE = 0.003
"""Largest mean distance between the object, or its part, in the plan and in the scene [m]. Two
captures of one scene differ by 1 mm; moving a mug by 5 mm, or turning it by 5 degrees, by 3 mm."""

_KEPT_SHARE = 0.9
"""Share of the points, the nearest ones, that are compared; the others may be noise at edges."""


def CheckPlanFits(plan: ExecutionPlan, scenario: Scenario, *, hardware: bool = False) -> None:
    """Checks that a plan was made for this scene, in the station's initial state.

    The scenario's detector finds object and part, as it did for the plan; no ground truth is used.
    The object's pose is not checked if the station has no cameras, or if the tracker is the
    ground-truth baseline, which needs none.

    Args:
        plan: The plan.
        scenario: Where it is to be executed.
        hardware: Whether the station is the real robot.

    Raises:
        PlanningError: if the plan does not fit, naming the first difference.
        DetectionError: if the object or its part is not detected.
    """
    pairs = (
        ("object", plan.object_label, scenario.poil.object),
        ("part", plan.part_label, scenario.poil.part),
    )
    for role, planned, wanted in pairs:
        if planned != wanted:
            raise PlanningError(
                f"The plan is for the {role} '{planned}', but poil.{role} is '{wanted}'.",
                remedy="Execute it in the scenario it was made for, or plan again: poil transfer.",
            )
    cameras = scenario.poil.tracker != GROUND_TRUTH
    with MakeStation(
        scenario, hardware=hardware, dry_run=True, cameras=cameras, ignore_output_delay=True
    ) as station:
        CheckArmPosition(plan, station)
        if station.camera_names:
            _check_object(plan, station)


def CheckArmPosition(plan: ExecutionPlan, station: Station) -> None:
    """Checks that the measured arm position is where the plan begins.

    Raises:
        PlanningError: if it is not, naming the joint that is farthest away.
    """
    position = station.ArmPosition(station.CreateDefaultContext())
    gaps = np.abs(position - plan.approach.positions[0])
    joint = int(np.argmax(gaps))
    if not gaps[joint] <= _JOINT_TOLERANCE:  # Catches NaN, too.
        raise PlanningError(
            f"The arm is not where the plan begins: joint {joint + 1} is "
            f"{gaps[joint]:.3f} rad away.",
            remedy="Move the arm to where it was when the plan was made (in simulation, set "
            "initial_position in the scenario), or plan again: poil transfer.",
        )


def _check_object(plan: ExecutionPlan, station: Station) -> None:
    poil = station.scenario.poil
    view = view_part(
        CaptureFrame(station, station.CreateDefaultContext(), labels=True),
        detector=make_detector(poil.detector),
        object_label=poil.object,
        part_label=poil.part,
    )
    pairs = (
        (f"object '{poil.object}'", plan.object_points, view.whole.points),
        (f"part '{poil.part}' of '{poil.object}'", plan.part_points, view.part.points),
    )
    for name, planned, seen in pairs:
        distance = surface_distance(planned, seen, _KEPT_SHARE)
        if distance > _SURFACE_TOLERANCE:
            raise PlanningError(
                f"The {name} does not match the plan: its surface is {1e3 * distance:.1f} mm from "
                f"the planned one, more than {1e3 * _SURFACE_TOLERANCE:g} mm.",
                remedy="Return the object and the cameras to where they were during planning (in "
                "simulation: use the plan's --seed), or plan again: poil transfer.",
            )


def surface_distance(first: np.ndarray, second: np.ndarray, kept_share: float) -> float:
    """Returns the distance between two clouds of the same surface [m].

    This is the mean distance from the points of one cloud to their nearest neighbours in the other,
    without the farthest points; of both directions, the larger value.

    Args:
        first: (N, 3) points [m].
        second: (M, 3) points [m].
        kept_share: Share of the points, the nearest ones, that are compared, in (0, 1].
    """
    distances = (cKDTree(second).query(first)[0], cKDTree(first).query(second)[0])
    return max(float(np.sort(d)[: max(1, int(kept_share * len(d)))].mean()) for d in distances)
