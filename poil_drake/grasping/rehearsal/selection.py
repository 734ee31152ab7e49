"""Selects the grasp and, if the part is symmetric, one of its matchings (POIL section III-B)."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from poil_drake.errors import NoFeasibleGraspError
from poil_drake.geometry.scene_cloud import SceneCloud
from poil_drake.grasping.candidates.grasp_candidate import GraspCandidate
from poil_drake.grasping.rehearsal.object_path import (
    ObjectPath,
    ObjectPathConfig,
    predict_object_path,
)
from poil_drake.grasping.rehearsal.rehearsal import (
    Failure,
    Feasibility,
    FeasibilityChecker,
    FeasibilityConfig,
)
from poil_drake.robots.inverse_kinematics import distinct_solutions
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.transfer.matching import Matching
from poil_drake.transfer.progress import Progress

_BATCH = 12  # Grasps rehearsed together, which bounds the memory needed.


@dataclass(frozen=True, eq=False)
class GraspChoice:
    """A feasible pair of grasp and matching.

    Attributes:
        candidate: The grasp.
        matching: Index of the matching.
        feasibility: Result of the pair's rehearsal.
        path: The object's predicted motion.
    """

    candidate: GraspCandidate
    matching: int
    feasibility: Feasibility
    path: ObjectPath


def rank_grasps(
    candidates: Sequence[GraspCandidate],
    matchings: Sequence[Matching],
    *,
    model: PandaModel,
    scene: SceneCloud,
    object_points: np.ndarray,
    part_points: np.ndarray,
    path: ObjectPathConfig | None = None,
    feasibility: FeasibilityConfig | None = None,
    progress: Progress | None = None,
) -> list[GraspChoice]:
    """Rehearses grasps under every matching and returns the feasible pairs, cheapest first.

    Args:
        candidates: Grasps, best first.
        matchings: The ways in which the part matches; several if it is symmetric.
        model: The arm.
        scene: The obstacles, without the object and the robot.
        object_points: (P, 3) the whole object [m, world].
        part_points: (M, 3) its functional part [m, world].
        path: How the object's motion is predicted; None for the defaults.
        feasibility: Requirements; None for the defaults.
        progress: Called with the current activity and its completed fraction.

    Raises:
        NoFeasibleGraspError: No pair is feasible; the message says how many fail for each reason.
    """
    path, feasibility = path or ObjectPathConfig(), feasibility or FeasibilityConfig()
    paths = [
        predict_object_path(
            matching,
            object_points=object_points,
            part_points=part_points,
            scene=scene,
            config=path,
            collision=feasibility.collision,
        )
        for matching in matchings
    ]
    checker = FeasibilityChecker(model=model, scene=scene, config=feasibility)
    best: dict[tuple[int, int], Feasibility | None] = {}
    for start in range(0, len(candidates), _BATCH):
        if progress:
            progress("rehearsing grasps", start / len(candidates))
        batch = candidates[start : start + _BATCH]
        configurations = distinct_solutions(model, np.array([grasp.X_WG for grasp in batch]))
        for number, object_path in enumerate(paths):
            findings = checker.rehearse(batch, configurations, object_path)
            for index in range(len(batch)):
                own = [f for f in findings if f.candidate == index]
                best[start + index, number] = min(own, key=_rank) if own else None
    feasible = {pair: f for pair, f in best.items() if f is not None and f.failure is None}
    if not feasible:
        raise _no_feasible_grasp(len(candidates), len(matchings), list(best.values()))
    if progress:
        progress("rehearsing grasps", 1.0)
    return [
        GraspChoice(candidates[index], number, finding, paths[number])
        for (index, number), finding in sorted(feasible.items(), key=lambda item: item[1].cost)
    ]


_FAILURES = list(Failure)
_NEARER = "move the fixture nearer to the robot and record the demonstration again"
_REMEDIES = {
    Failure.OUT_OF_REACH: "Move the object to about 0.35 to 0.6 m in front of the robot.",
    Failure.APPROACH: "Move the object nearer to the robot.",
    Failure.PATH: f"Turn or move the object, or {_NEARER}.",
    Failure.RETREAT: "Move the fixture nearer to the robot and record the demonstration again.",
    Failure.SINGULAR: f"Move the object away from the edge of the arm's reach, or {_NEARER}.",
    Failure.WORKSPACE: "Widen the box (poil.safety.posture), or move object and fixture away from "
    "that face, and record the demonstration again if the fixture has moved.",
    Failure.ROBOT_COLLISION: "Clear the space around the object and the fixture, and check the "
    "cameras' poses.",
    Failure.OBJECT_COLLISION: "Check that the fixture is where it was in the demonstration, and "
    "that the goal is not occupied.",
    Failure.NOT_CONVERGED: "Raise poil.max_linear_speed or poil.max_angular_speed, or record a "
    "shorter demonstration.",
}


def _rank(finding: Feasibility) -> tuple[float, int, float]:
    """Returns the sort key of findings: feasible by cost, then others, last `Failure` first."""
    passed = -_FAILURES.index(finding.failure) if finding.failure else 0
    outside = finding.failure is Failure.WORKSPACE
    return finding.cost, passed, -finding.workspace_clearance if outside else 0.0


def _no_feasible_grasp(
    candidates: int, matchings: int, findings: list[Feasibility | None]
) -> NoFeasibleGraspError:
    if not candidates:
        return NoFeasibleGraspError(
            "No grasp was found on the object: there is no place where the fingers fit around it "
            "without touching the functional part or the scene.",
            remedy="Check the masks of object and part, and clear the space around the object.",
        )
    failures = Counter(
        Failure.OUT_OF_REACH if f is None or f.failure is None else f.failure for f in findings
    )
    counts = ", ".join(f"{n} {failure.value}" for failure, n in failures.most_common())
    ways = "" if matchings == 1 else f" under any of the {matchings} matchings"
    outside = [f for f in findings if f is not None and f.failure is Failure.WORKSPACE]
    face = f" In the best case, {min(outside, key=_rank).tightest_face}." if outside else ""
    return NoFeasibleGraspError(
        f"None of the {candidates} grasps is feasible{ways}: {counts}.{face}",
        remedy=_REMEDIES[failures.most_common(1)[0][0]],
    )
