"""Random scenes: a mug that stands or lies, among other objects."""

import copy
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files

import numpy as np
import trimesh
from pydrake.common.schema import Rotation, Transform
from pydrake.math import RollPitchYaw, RotationMatrix
from pydrake.multibody.parsing import AddModel, ModelDirective

from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.diagrams.scenario.randomization import ObjectDirective
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station import CaptureFrame, MakeStation
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.robot_filter import without_robot
from poil_drake.robots.panda import MAX_HAND_WIDTH
from poil_drake.robots.panda_kinematics import PandaModel

_MUGS = "abcdefg"
_X, _Y = (0.36, 0.62), (-0.28, 0.05)  # where objects stand [m]
_MUG_RADIUS, _GAP = 0.075, 0.004  # [m]
_CLUTTER = {
    "can": (0.05, 0.0),
    "bottle": (0.05, 0.0),
    "carton": (0.05, 0.0),
    "pan": (0.12, 0.0),
    "ladle_pot": (0.08, 0.0),
    "cube": (0.05, 0.025),
    "book": (0.11, 0.1),
}
"""Radius that each object needs, and the height of its frame [m]."""

_MOST_CLUTTER = 3
_LYING_SHARE = 0.25
_HIDDEN_PIXELS = 20  # a part with fewer pixels is hidden
_HIDDEN_TRIALS = 40
_AWAY = np.deg2rad(30.0)  # between a hidden handle and the line of sight [rad]


@dataclass(frozen=True)
class DetectionScene:
    """A random scene.

    Attributes:
        frame: The views, with labels, without depth where they show the robot.
        mug: Name of the mug's model.
        lying: Whether the mug lies on its side.
        clutter: The names of the other objects.
    """

    frame: MultiViewFrame
    mug: str
    lying: bool
    clutter: tuple[str, ...]

    def part_masks(self) -> tuple[np.ndarray, ...]:
        """Returns where the views show the mug's handle."""
        ids = self.frame.label_ids["mug/handle"]
        labels = [image.label for image in self.frame.images]
        return tuple(np.isin([] if label is None else label, ids) for label in labels)

    def part_pixels(self) -> int:
        """Returns how many pixels show the mug's handle."""
        return sum(int(np.count_nonzero(mask)) for mask in self.part_masks())


def MakeDetectionScene(seed: int, *, hidden: bool = False) -> DetectionScene:
    """Returns a random scene of the package's scenario.

    Args:
        seed: The same seed draws the same scene.
        hidden: Whether there is only one view, which does not show the handle.
    """
    for trial in range(_HIDDEN_TRIALS):
        scene = _draw([seed, trial, hidden], hidden)
        if not hidden or scene.part_pixels() < _HIDDEN_PIXELS:
            return scene
    return scene


def _draw(seed: list[int], hidden: bool) -> DetectionScene:
    rng = np.random.default_rng(seed)
    mug = f"mug_{_MUGS[rng.integers(len(_MUGS))]}"
    yaw = rng.uniform(-np.pi, np.pi)
    lying = not hidden and rng.random() < _LYING_SHARE
    R, height = np.eye(3), 0.0
    if lying:
        poses = _lying_poses(mug)
        R, height = poses[rng.integers(len(poses))]
    taken: list[tuple[np.ndarray, float]] = []
    place = _free_place(rng, taken, _MUG_RADIUS)
    cameras = sorted(_scenario().cameras)
    if hidden:
        cameras = [str(rng.choice(cameras))]
        eye = _scenario().cameras[cameras[0]].X_PB.translation
        yaw = np.arctan2(*(place - eye[:2])[::-1]) + rng.uniform(-_AWAY, _AWAY)
    R = RotationMatrix.MakeZRotation(yaw).matrix() @ R
    directives = copy.deepcopy(list(_scenario().directives))
    model = ObjectDirective(directives, "mug")
    model.file = f"package://poil_drake/mugs/{mug}/{mug}.sdf"
    model.default_free_body_pose = {"body": _transform(place, height, R)}
    clutter = []
    for name in rng.permutation(sorted(_CLUTTER))[: rng.integers(_MOST_CLUTTER + 1)]:
        radius, height = _CLUTTER[name]
        where = _free_place(rng, taken, radius)
        if where is None:
            continue
        turn = RotationMatrix.MakeZRotation(rng.uniform(-np.pi, np.pi)).matrix()
        other = AddModel(name=name, file=f"package://poil_drake/objects/{name}.sdf")
        other.default_free_body_pose = {"body": _transform(where, height, turn)}
        directives.append(ModelDirective(add_model=other))
        clutter.append(str(name))
    scenario = replace(_scenario(), directives=directives, random_seed=int(rng.integers(2**31)))
    return _captured(scenario, cameras, mug, lying, tuple(clutter))


def _captured(
    scenario: Scenario, cameras: list[str], mug: str, lying: bool, clutter: tuple[str, ...]
) -> DetectionScene:
    scenario = replace(scenario, cameras={name: scenario.cameras[name] for name in cameras})
    with MakeStation(scenario, dry_run=True, ignore_output_delay=True) as station:
        context = station.CreateDefaultContext()
        frame = CaptureFrame(station, context, labels=True)
        model = PandaModel(X_WB=station.robot_base_pose().GetAsMatrix4())
        q = station.ArmPosition(context)
    seen = without_robot(frame, model, q, MAX_HAND_WIDTH)
    return DetectionScene(seen, mug, lying, clutter)


@cache
def _scenario() -> Scenario:
    return ChooseScenario()


@cache
def _lying_poses(mug: str) -> list[tuple[np.ndarray, float]]:
    """Returns the rotations and heights in which a mug lies stably on its side."""
    folder = files("poil_drake") / "models" / "mugs" / mug
    meshes = [
        trimesh.load(str(folder / f"{mug}_{part}.obj"), force="mesh", process=False)
        for part in ("body", "handle")
    ]
    hull = trimesh.util.concatenate(meshes).convex_hull
    transforms, _ = trimesh.poses.compute_stable_poses(hull, n_samples=1, threshold=0.01)
    return [(X[:3, :3], float(X[2, 3])) for X in transforms if abs(X[2, 2]) < 0.7]


def _free_place(
    rng: np.random.Generator, taken: list[tuple[np.ndarray, float]], radius: float
) -> np.ndarray | None:
    """Draws a free place (2,) [m] and takes it; None if none is found."""
    for _ in range(200):
        place = np.array([rng.uniform(*_X), rng.uniform(*_Y)])
        if all(np.linalg.norm(place - p) > radius + r + _GAP for p, r in taken):
            taken.append((place, radius))
            return place
    return None


def _transform(place: np.ndarray | None, height: float, R: np.ndarray) -> Transform:
    assert place is not None, "the first place is free"
    rotation = Rotation(RollPitchYaw(RotationMatrix(R)))
    return Transform(translation=np.append(place, height), rotation=rotation)
