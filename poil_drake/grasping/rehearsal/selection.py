"""Selects the grasp and, if the part is symmetric, one of its matchings (POIL section III-B)."""

from collections import Counter
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial

import numpy as np

from poil_drake.errors import NoFeasibleGraspError
from poil_drake.geometry.scene_cloud import SceneCloud
from poil_drake.grasping.candidates.grasp_candidate import GRIPPER, GraspCandidate
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
from poil_drake.runtime.worker_executor import run_in_halves
from poil_drake.transfer.matching import Matching
from poil_drake.transfer.progress import Progress

_OPENING = 1000.0 * GRIPPER.max_width  # [mm]
_BATCH = 12  # Grasps rehearsed at once in a process, which bounds the memory needed.


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
    executor: Executor | None = None,
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
        executor: Rehearses half of the grasps; None: this process rehearses all.
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
    rehearse = partial(_best_findings, model=model, checker=checker, paths=paths)
    best: list[list[Feasibility | None]] = []
    while len(best) < len(candidates):
        if progress:
            progress("rehearsing grasps", len(best) / len(candidates))
        best += run_in_halves(rehearse, candidates[len(best) : len(best) + 2 * _BATCH], executor)
    choices = [
        GraspChoice(candidate, number, finding, paths[number])
        for candidate, findings in zip(candidates, best, strict=True)
        for number, finding in enumerate(findings)
        if finding is not None and finding.failure is None
    ]
    if not choices:
        findings = [finding for own in best for finding in own]
        raise _no_feasible_grasp(len(candidates), len(matchings), findings)
    if progress:
        progress("rehearsing grasps", 1.0)
    return sorted(choices, key=lambda choice: choice.feasibility.cost)


def _best_findings(
    candidates: Sequence[GraspCandidate],
    *,
    model: PandaModel,
    checker: FeasibilityChecker,
    paths: Sequence[ObjectPath],
) -> list[list[Feasibility | None]]:
    """Returns each grasp's best finding on each path, or None if it is out of the arm's reach."""
    configurations = distinct_solutions(model, np.array([grasp.X_WG for grasp in candidates]))
    best: list[list[Feasibility | None]] = [[] for _ in candidates]
    for path in paths:
        findings = checker.rehearse(candidates, configurations, path)
        for index, own in enumerate(best):
            own.append(min((f for f in findings if f.candidate == index), key=_rank, default=None))
    return best


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
    Failure.ROBOT_COLLISION: "Clear the space around the object and the fixture, check the "
    "cameras' poses, or lower poil.clearance.robot_margin.",
    Failure.OBJECT_COLLISION: "Check that the fixture is where it was in the demonstration, and "
    "that the goal is not occupied, or lower poil.clearance.object_margin.",
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
            f"without touching the functional part or the scene. They open {_OPENING:.0f} mm; "
            "wider objects are grasped by a rim.",
            remedy="Check the masks of object and part, clear the space around the object, or "
            "lower poil.grasp.part_clearance.",
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
