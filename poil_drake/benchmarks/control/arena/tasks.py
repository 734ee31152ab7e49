"""The four tasks of the control study (POIL, table II)."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np

import poil_drake.models
from poil_drake.diagrams.demonstration.hanging_motion import hanging_keyframes
from poil_drake.diagrams.demonstration.scene import DemonstrationScene
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.geometry.point_cloud import farthest_point_sampling
from poil_drake.geometry.rigid_transform import make_transform, rotation_exp
from poil_drake.models.bag_sdf import BagParameters, handle_vertices
from poil_drake.models.mug_family import NAMED_MUGS
from poil_drake.models.mug_mesh import handle_mesh

MODELS = Path(poil_drake.models.__file__).parent

NEAR_HALF = (0.05, 0.05)
"""Half the extent in x and y of the Near region, centred at the demonstration's start [m]."""

SUCCESS_DISTANCE = 0.01
"""A trial succeeds below this distance from the goal, as in the paper (POIL) [m]."""

POINT_COUNT = 10
"""Number of points, N_k in the paper (POIL)."""

_ABOVE_TABLE = 0.005
"""Height above the table or shelf at which objects start and end, so as not to touch it [m]."""


@dataclass(frozen=True, kw_only=True)
class Fixture:
    """A static model.

    Attributes:
        file: SDFormat file, relative to the package's models.
        link: Name of the link that is welded to the world.
        position: Position of that link [m, world].
    """

    file: str
    link: str
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class ControlTask:
    """A task of the paper (POIL): an object, the fixtures, and the one demonstration.

    Attributes:
        name: Name in files and on the command line.
        title: Name in tables and pictures, taken from the paper.
        object_file: SDFormat file of the object, relative to the package's models.
        fixtures: The static models.
        carriers: For each of the N points, the name of the object's link that carries it.
        link_points: (N, 3) the points, each in the frame of its link [m].
        times: (K,) times of the demonstration's keyframes [s].
        keyframes: (K, 4, 4) poses of the object's first link at these times.
        criterion: Whether the distance from the goal, the demonstration's end, is that of the
            object's origin ("center") or the mean distance of the points ("points").
        far_lower: Lower corner (x, y) of the Far region, from the demonstration's start [m].
        far_upper: Upper corner (x, y) of the Far region, from the demonstration's start [m].
        rigid: Whether the object keeps its shape. Gravity does not act on a rigid object.
        paper: Success rates (near, far) [%] by row of the paper's table II.
    """

    name: str
    title: str
    object_file: str
    fixtures: tuple[Fixture, ...]
    carriers: tuple[str, ...]
    link_points: np.ndarray
    times: np.ndarray
    keyframes: np.ndarray
    criterion: Literal["center", "points"]
    far_lower: tuple[float, float] = (-0.40, -0.40)
    far_upper: tuple[float, float] = (0.40, 0.40)
    rigid: bool = True
    paper: dict[str, tuple[int, int]]

    @property
    def start(self) -> np.ndarray:
        """(4, 4) pose of the object's first link at the start of the demonstration, world."""
        return self.keyframes[0]


_TABLE = Fixture(file="fixtures/table.sdf", link="table")
_RACK = Fixture(file="fixtures/rack.sdf", link="stand", position=(0.55, 0.30, 0.0))
_ROD_SEAT, _ROD_LENGTH = 0.54, 0.14
_ROD_DIRECTION = np.array([0.0, -math.cos(math.radians(15)), math.sin(math.radians(15))])
_ROD_BASE = np.array([0.55, 0.30, 0.26])


@cache
def MakeTask(name: str) -> ControlTask:
    """Returns the task with a name from `TASKS`."""
    return _MAKERS[name]()


def _pick_and_place_cube() -> ControlTask:
    z = 0.025 + _ABOVE_TABLE
    start, goal, up = (0.40, -0.20, z), (0.55, 0.20, z), 0.15
    waypoints = [start, start, (0.40, -0.20, z + up), (0.55, 0.20, z + up), goal, goal]
    times, keyframes = _straight_keyframes([0.5, 1.0, 2.5, 1.0, 0.5], waypoints)
    return ControlTask(
        name="pnp_cube",
        title="PnP Cube",
        object_file="objects/cube.sdf",
        fixtures=(_TABLE,),
        carriers=("body",) * POINT_COUNT,
        link_points=_box_points((0.05, 0.05, 0.05)),
        times=times,
        keyframes=keyframes,
        criterion="center",
        paper={"pp_1": (100, 54), "pp_50": (100, 100), "ip_1": (100, 100), "ours": (100, 100)},
    )


def _reshelving() -> ControlTask:
    low, high = 0.10 + _ABOVE_TABLE, 0.32 + 0.10 + _ABOVE_TABLE
    over = high + 0.015
    waypoints = [
        *[(0.70, 0.0, low)] * 2,
        *[(0.40, 0.0, low), (0.40, 0.0, over), (0.70, 0.0, over)],
        *[(0.70, 0.0, high)] * 2,
    ]
    times, keyframes = _straight_keyframes([0.5, 2.0, 2.0, 2.0, 0.75, 0.5], waypoints)
    return ControlTask(
        name="reshelving",
        title="Reshelving",
        object_file="objects/book.sdf",
        fixtures=(_TABLE, Fixture(file="fixtures/shelf.sdf", link="shelf", position=(0.55, 0, 0))),
        carriers=("body",) * POINT_COUNT,
        link_points=_box_points((0.14, 0.03, 0.20)),
        times=times,
        keyframes=keyframes,
        criterion="center",
        # From the back wall to the front of the shelf, between its sides.
        far_lower=(-0.50, -0.28),
        far_upper=(0.08, 0.28),
        paper={"pp_1": (71, 31), "pp_50": (100, 57), "ip_1": (4, 3), "ours": (100, 100)},
    )


def _mug_insertion() -> ControlTask:
    scenario = ChooseScenario(seed=0)
    hanging = scenario.poil.demonstration_motion.hanging
    times, keyframes = hanging_keyframes(DemonstrationScene(scenario, cameras=False), hanging)
    keyframes = keyframes.copy()
    keyframes[:3, 2, 3] += _ABOVE_TABLE
    mug = next(mug for mug in NAMED_MUGS if mug.name == "mug_demo")
    # Samples the surface: of all its points, those farthest apart would lie in one plane.
    handle = np.random.default_rng(0).permutation(np.asarray(handle_mesh(mug).vertices))[:60]
    return ControlTask(
        name="mug_insertion",
        title="Mug Insert.",
        object_file="mugs/mug_demo/mug_demo.sdf",
        fixtures=(_TABLE, _RACK),
        carriers=("handle",) * POINT_COUNT,
        link_points=handle[farthest_point_sampling(handle, POINT_COUNT)],
        times=times,
        keyframes=keyframes,
        criterion="points",
        paper={"pp_1": (33, 25), "pp_50": (100, 84), "ip_1": (0, 0), "ours": (100, 100)},
    )


def _hanging_bag() -> ControlTask:
    bag = BagParameters()
    half_height = 0.5 * bag.body[2]
    seat = _ROD_BASE + _ROD_SEAT * _ROD_LENGTH * _ROD_DIRECTION
    opening = half_height + 0.45 * bag.handle_height
    over = seat - np.array([0.0, 0.0, opening])
    before = over + ((1.0 - _ROD_SEAT) * _ROD_LENGTH + 0.06) * _ROD_DIRECTION
    rod_radius, pressed = 0.0055, 0.03
    underside = half_height + bag.handle_height - bag.handle_radius
    hung = seat + np.array([0.0, 0.0, rod_radius - underside - pressed])
    start = np.array([0.45, -0.13, half_height + _ABOVE_TABLE])
    lifted = start + np.array([0.0, 0.0, 0.14])
    waypoints = [start, start, lifted, before, over, hung, hung]
    times, keyframes = _straight_keyframes([0.5, 1.0, 2.5, 1.5, 1.0, 0.5], waypoints)
    keyframes[:3, :3, :3] = rotation_exp(np.array([0.0, 0.0, math.radians(40)]))
    carriers, link_points = _strap_points(bag)
    return ControlTask(
        name="hanging_bag",
        title="Hanging Bag",
        object_file="bags/soft_bag/soft_bag.sdf",
        fixtures=(_TABLE, _RACK),
        carriers=carriers,
        link_points=link_points,
        times=times,
        keyframes=keyframes,
        criterion="points",
        rigid=False,
        paper={"pp_1": (51, 45), "pp_50": (100, 100), "ip_1": (23, 19), "ours": (100, 100)},
    )


_MAKERS: dict[str, Callable[[], ControlTask]] = {
    "pnp_cube": _pick_and_place_cube,
    "mug_insertion": _mug_insertion,
    "reshelving": _reshelving,
    "hanging_bag": _hanging_bag,
}

TASKS = tuple(_MAKERS)
"""The names of the tasks, in the order of POIL's table II."""


def _straight_keyframes(
    durations: Sequence[float], positions: Sequence[Sequence[float] | np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Returns times (K,) [s] and poses (K, 4, 4) without rotation."""
    times = np.concatenate([[0.0], np.cumsum(durations)])
    return times, make_transform(np.eye(3), np.array(positions))


def _box_points(size: tuple[float, float, float]) -> np.ndarray:
    """Returns points (N, 3) on the surface of a box, spread out, but without symmetry [m]."""
    rng = np.random.default_rng(0)
    samples = rng.uniform(-0.5, 0.5, size=(600, 3))
    face = rng.integers(0, 3, size=600)
    samples[np.arange(600), face] = np.copysign(0.5, samples[np.arange(600), face])
    samples *= size
    return samples[farthest_point_sampling(samples, POINT_COUNT)]


def _strap_points(bag: BagParameters) -> tuple[tuple[str, ...], np.ndarray]:
    """Returns N link names of a bag's strap, and a point (N, 3) on each, in its frame [m]."""
    lengths = np.linalg.norm(np.diff(handle_vertices(bag), axis=0), axis=1)
    places = np.linspace(0.5, bag.links - 0.5, POINT_COUNT)
    links = np.minimum(places.astype(int), bag.links - 1)
    side = bag.handle_radius * np.where(np.arange(POINT_COUNT) % 2 == 0, 1.0, -1.0)
    along = (places - links) * lengths[links]
    p_BP = np.stack([np.zeros(POINT_COUNT), side, along], axis=1)
    return tuple(f"handle_{k}" for k in links), p_BP
