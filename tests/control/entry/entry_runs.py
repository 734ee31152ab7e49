"""Runs of a rigid object that moves with the twist of safe entry, at limited speed."""

from dataclasses import dataclass, field

import numpy as np
from entry_scenes import Scene

from poil_drake.control.entry.entry_monitor import safe_entry_step
from poil_drake.control.entry.entry_state import EntryMonitorConfig, EntryState, EntryStatus
from poil_drake.control.entry.safe_entry import SafeEntryPlanner
from poil_drake.control.field.point_set_bcsdm import BcsdmStatus
from poil_drake.control.field.twist_fit import scale_twist
from poil_drake.geometry.rigid_fit import kabsch
from poil_drake.geometry.rigid_transform import moved_by_twist, transform_points

STEP = 1.0 / 32.0


@dataclass
class Run:
    reached: bool = False
    poses: list = field(default_factory=list)
    states: list = field(default_factory=list)

    @property
    def X_WO(self):
        return np.array(self.poses)


def drive(
    scene: Scene,
    planner: SafeEntryPlanner,
    X_WO: np.ndarray,
    *,
    max_time=40.0,
    pushes=None,
    noise=0.0,
    rng=None,
    monitor: EntryMonitorConfig | None = None,
):
    """Runs until the goal; `pushes` maps step numbers to motions (4, 4) of the world."""
    monitor = monitor or EntryMonitorConfig()
    run, state = Run(), EntryState()
    for k in range(int(max_time / STEP)):
        if pushes and k in pushes:
            X_WO = pushes[k] @ X_WO
        run.poses.append(X_WO)
        points = transform_points(X_WO, scene.points)
        if noise:
            points = points + noise * rng.normal(size=points.shape)
        state = safe_entry_step(state, points, k * STEP, planner, monitor)
        run.states.append(state)
        if state.status is EntryStatus.FAILED and state.plan is None:
            return run
        if state.output is None:
            continue
        if state.output.status is BcsdmStatus.GOAL:
            run.reached = True
            return run
        V = scale_twist(state.output.twist, 1.5, 0.3)
        X_WO = moved_by_twist(X_WO, V, state.output.centroid, STEP)
    return run


def shortfall(scene: Scene, X_WO: np.ndarray, *, margin, slack):
    """Returns by how much the clearance at poses (K, 4, 4) is too small (K,) [m].

    Required is the margin, or the clearance of the demonstration's nearest sample less the slack.
    """
    positions = scene.reference.positions
    shown = scene.distance(kabsch(np.broadcast_to(scene.points, positions.shape), positions))
    points = transform_points(X_WO, scene.points)
    squares = np.sum((points[:, None] - positions) ** 2, axis=(2, 3))
    enough = np.minimum(margin, shown[np.argmin(squares, axis=1)] - slack)
    return enough - scene.distance(X_WO)
