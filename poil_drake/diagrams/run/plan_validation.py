"""Checks that a plan fits the scene in which it is executed."""

import numpy as np
from scipy.spatial import cKDTree

from poil_drake.diagrams.loop.perception import MakeRunDetector
from poil_drake.diagrams.scenario.scenario import GROUND_TRUTH, Scenario
from poil_drake.diagrams.station.station import (
    CaptureFrame,
    MakeStation,
    Station,
    WithoutRobot,
)
from poil_drake.errors import PlanningError
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.perception.detectors.registry import LABEL_IMAGE
from poil_drake.transfer.part_points import view_part

_JOINT_TOLERANCE = 0.01
"""Largest distance of a joint from its position in the plan's first posture [rad]. With the arm
stretched out, 0.01 rad moves the hand by 1 cm, about the clearance of planned motions."""

_SURFACE_TOLERANCE = 0.003
"""Largest mean distance between the planned and the seen surface of the object, or of its part [m].
Two captures of one scene differ by 1 mm. If a mug is moved by 5 mm, or turned by 5 degrees, the
captures before and after differ by 3 mm."""

_KEPT_SHARE = 0.9
"""Share of the points that are compared, nearest first. The farthest may be noise at edges."""


def CheckPlanFits(plan: ExecutionPlan, scenario: Scenario, *, hardware: bool = False) -> None:
    """Checks that a plan fits a scenario's scene in its initial state.

    The plan must be for the scenario's object and part, and begin at the arm's measured position.
    The scenario's detector must find the object and the part where they were during planning. This
    check is omitted if the station has no cameras or the tracker is the ground-truth baseline.

    Args:
        plan: The plan.
        scenario: The scenario in which the plan is to be executed.
        hardware: Whether the station is the real robot.

    Raises:
        PlanningError: if the plan does not fit. The text states the first difference.
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
                remedy="Execute the plan in its own scenario, or plan again: poil transfer.",
            )
    cameras = scenario.poil.tracker != GROUND_TRUTH
    with MakeStation(
        scenario, hardware=hardware, dry_run=True, cameras=cameras, ignore_output_delay=True
    ) as station:
        CheckArmPosition(plan, station)
        if station.camera_names:
            _check_object(plan, station)


def CheckArmPosition(plan: ExecutionPlan, station: Station) -> None:
    """Checks that the station's arm is where the plan begins.

    Raises:
        PlanningError: if a joint is too far from its planned position. The text states which.
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
    context = station.CreateDefaultContext()
    frame = CaptureFrame(station, context, labels=poil.detector == LABEL_IMAGE)
    masks = MakeRunDetector(poil, plan).detect(
        WithoutRobot(station, context, frame),
        object_label=poil.object,
        part_label=poil.part,
    )
    view = view_part(frame, masks, poil.fusion)
    pairs = (
        (f"object '{poil.object}'", plan.object_points, view.whole.points),
        (f"part '{poil.part}' of '{poil.object}'", plan.part_points, view.part.points),
    )
    for name, planned, seen in pairs:
        distance = surface_distance(planned, seen)
        if distance > _SURFACE_TOLERANCE:
            raise PlanningError(
                f"The {name} does not match the plan: its surface is {1e3 * distance:.1f} mm from "
                f"the surface in the plan, more than {1e3 * _SURFACE_TOLERANCE:g} mm.",
                remedy="Return the object and the cameras to where they were during planning (in "
                "simulation: use the plan's --seed), or plan again: poil transfer.",
            )


def surface_distance(first: np.ndarray, second: np.ndarray) -> float:
    """Returns the distance between two point clouds of the same surface [m].

    Each point has a distance to the nearest point of the other cloud. These distances are averaged
    over the `_KEPT_SHARE` of each cloud that is nearest. The larger average is the result.

    Args:
        first: (N, 3) points [m].
        second: (M, 3) points [m].
    """
    distances = (cKDTree(second).query(first)[0], cKDTree(first).query(second)[0])
    return max(float(np.sort(d)[: max(1, int(_KEPT_SHARE * len(d)))].mean()) for d in distances)
