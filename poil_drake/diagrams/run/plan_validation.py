"""Whether a plan fits the scene in which it is to be executed."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from poil_drake.diagrams.scenario.checks import GROUND_TRUTH
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station import CaptureFrame, MakeStation, Station
from poil_drake.errors import PlanningError
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.perception.detectors.registry import make_detector
from poil_drake.transfer.part_points import view_part


@dataclass(frozen=True, kw_only=True)
class PlanFitConfig:
    """How far a scene may differ from what a plan has seen.

    Attributes:
        joint_tolerance: How far a joint may stand from where the approach begins [rad]. With the
            arm stretched out, 0.01 rad move the hand by 1 cm, about what motions keep clear of
            obstacles.
        surface_tolerance: Largest mean distance between what the plan has seen of the object, or
            of its part, and what is seen now [m]. Two looks at the same scene differ by 1 mm; a
            shift by 5 mm, or a turn of a mug by 5 degrees, makes 3 mm.
        kept_share: Share of the points that counts, those nearest; the others may be noise at
            edges.
    """

    joint_tolerance: float = 0.01
    surface_tolerance: float = 0.003
    kept_share: float = 0.9


def CheckPlanFits(
    plan: ExecutionPlan,
    scenario: Scenario,
    *,
    hardware: bool = False,
    config: PlanFitConfig | None = None,
) -> None:
    """Checks that a plan was made for this scene, as the station shows it before it moves.

    Object and part are looked for with the scenario's detector, as when the plan was made; no
    ground truth is used. Where nothing looks through cameras, because there are none or the
    ground-truth baseline needs none, it is not checked where the object stands.

    Args:
        plan: The plan.
        scenario: Where it is to be executed.
        hardware: Whether the station is the real robot.
        config: Tolerances.

    Raises:
        PlanningError: naming the first difference.
        DetectionError: when the object or its part is not seen.
    """
    config = config or PlanFitConfig()
    _check_labels(plan, scenario)
    looking = scenario.poil.tracker != GROUND_TRUTH
    with MakeStation(
        scenario, hardware=hardware, dry_run=True, cameras=looking, ignore_output_delay=True
    ) as station:
        CheckArmStands(plan, station, config)
        if station.camera_names:
            _check_object(plan, station, config)


def surface_distance(first: np.ndarray, second: np.ndarray, kept_share: float) -> float:
    """Returns how far two clouds of one surface are apart [m].

    The mean distance of the points of either to the nearest ones of the other, without the farthest
    points; the larger of both directions.

    Args:
        first: (N, 3) points [m].
        second: (M, 3) points [m].
        kept_share: Share of the points that counts, in (0, 1].
    """
    distances = (cKDTree(second).query(first)[0], cKDTree(first).query(second)[0])
    return max(float(np.sort(d)[: max(1, int(kept_share * len(d)))].mean()) for d in distances)


def _check_labels(plan: ExecutionPlan, scenario: Scenario) -> None:
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


def CheckArmStands(
    plan: ExecutionPlan, station: Station, config: PlanFitConfig | None = None
) -> None:
    """Checks that the arm stands where a plan begins.

    Args:
        plan: The plan.
        station: The arm, as it is measured now.
        config: Tolerances.

    Raises:
        PlanningError: naming the joint that is farthest away.
    """
    config = config or PlanFitConfig()
    position = station.ArmPosition(station.CreateDefaultContext())
    gaps = np.abs(position - plan.approach.positions[0])
    joint = int(np.argmax(gaps))
    if gaps[joint] > config.joint_tolerance:
        raise PlanningError(
            f"The arm does not stand where the plan begins: joint {joint + 1} is "
            f"{gaps[joint]:.3f} rad away.",
            remedy="Put it where it was when the plan was made (in simulation: initial_position), "
            "or plan again: poil transfer.",
        )


def _check_object(plan: ExecutionPlan, station: Station, config: PlanFitConfig) -> None:
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
        distance = surface_distance(planned, seen, config.kept_share)
        if distance > config.surface_tolerance:
            raise PlanningError(
                f"The {name} is not as the plan has seen it: surfaces are {1e3 * distance:.0f} mm "
                "apart.",
                remedy="Put back object and cameras as they were (option --seed draws another "
                "pose), or plan again: poil transfer.",
            )
