"""Rules for the arm's posture: inside a box, above the table, and clear of itself."""

import math
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.scene_cloud import SceneCloud
from poil_drake.robots.collision import CollisionConfig, RobotCollisionChecker
from poil_drake.robots.panda import NUM_JOINTS
from poil_drake.robots.panda_hand import GripperGeometry
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.robots.panda_spheres import (
    GRIPPER_LINK,
    RobotSpheres,
    RobotSpheresConfig,
    make_robot_spheres,
)

_FIRST_LINK = 2
"""The first link to check; links 0 and 1 at most turn about their axis, and may touch the table."""

_SELF_REACH = 0.05
"""Cap on the self-clearance minus `self_margin` [m]; a smaller cap makes the check faster."""

_ROUNDING = 1e-9
"""Clearances that differ by no more than this count as equal [m]."""

Box = tuple[float, float, float]


class PostureRule(IntEnum):
    """A rule for postures; the value is its column in `PostureGuard.clearances`."""

    WORKSPACE = 0
    TABLE = 1
    SELF_COLLISION = 2


@dataclass(frozen=True, kw_only=True)
class PostureGuardConfig:
    """The workspace that the arm must stay in.

    The boxes are aligned with the world's axes and measured from the robot's base [m]. By default
    they contain the arm's whole useful reach; narrow them to your cell.

    Attributes:
        gripper_lower: Lower corner of the box for the gripper point, between the finger tips.
        gripper_upper: Upper corner of that box.
        body_lower: Lower corner of the box for the arm from panda_link2 on, including the elbow.
            The box keeps the arm away from walls and people.
        body_upper: Upper corner of that box.
        table_height: Height of the table, an infinite plane, in the world [m]; None without one.
        table_margin: Distance that the arm, the hand and the tips of the closed fingers keep from
            the table [m]. It must be less than the 6 mm that planned grasps keep. It can be small
            because the model of the tips is exact.
        self_margin: Distance that the wrist and the hand keep from the shoulder [m], measured
            between spheres that bulge beyond the robot by 5-10 mm.
        spheres: How finely the robot's shape is covered.
    """

    gripper_lower: Box = (-0.85, -0.85, -1.0)
    gripper_upper: Box = (0.85, 0.85, 1.2)
    body_lower: Box = (-1.1, -1.1, -1.0)
    body_upper: Box = (1.1, 1.1, 1.5)
    table_height: float | None = 0.0
    table_margin: float = 0.002
    self_margin: float = 0.0
    spheres: RobotSpheresConfig = field(default_factory=RobotSpheresConfig)

    def __post_init__(self) -> None:
        for name in ("gripper", "body"):
            lower, upper = getattr(self, f"{name}_lower"), getattr(self, f"{name}_upper")
            if not np.shape(lower) == np.shape(upper) == (3,) or not np.less(lower, upper).all():
                raise InvalidValueError(
                    f"PostureGuardConfig.{name}_lower is {lower} and {name}_upper is {upper}.",
                    remedy="Set each to three numbers, every lower one below its upper one.",
                )
        for name in ("table_height", "table_margin", "self_margin"):
            value = getattr(self, name)
            if value is not None and not math.isfinite(value):
                raise InvalidValueError(
                    f"PostureGuardConfig.{name} is {value}.", remedy="It must be finite."
                )


class PostureGuard:
    """Checks postures against the rules of `PostureGuardConfig`.

    `RobotSpheres` represent the arm. For the boxes and the table, the corners of the hand's box and
    of the closed finger tips represent the hand. Open fingers reach farther down than closed ones,
    by up to 4 cm times the sine of the hand's tilt. Held objects are ignored.
    """

    def __init__(self, *, model: PandaModel, config: PostureGuardConfig | None = None):
        """Prepares the check.

        Args:
            model: The arm's kinematics, with the pose of its base in the world.
            config: The rules.
        """
        self._config = config = config or PostureGuardConfig()
        self._model = model
        spheres = make_robot_spheres(finger_opening=None, config=config.spheres)
        self._checker = RobotCollisionChecker(
            model=model,
            spheres=spheres,
            scene=SceneCloud(np.zeros((0, 3))),
            config=CollisionConfig(max_distance=config.self_margin + _SELF_REACH),
        )
        self._centers, self._radii = _outline(spheres, config.spheres.gripper)
        self._reaches = self._joint_reaches()
        base = model.X_WB[:3, 3]
        # Rows: the gripper point, then the whole arm.
        self._lower = base + np.array([config.gripper_lower, config.body_lower])
        self._upper = base + np.array([config.gripper_upper, config.body_upper])
        table = -np.inf if config.table_height is None else config.table_height
        self._lowest_height = table + config.table_margin

    def clearances(self, q: np.ndarray) -> np.ndarray:
        """Returns how far each posture is from breaking each rule, (B, 3) [m]; negative if broken.

        The columns are indexed by `PostureRule`: the depth inside the boxes, the height above the
        table minus `table_margin`, and the self-clearance minus `self_margin`, capped at 5 cm.

        Args:
            q: (B, 7) joint positions [rad].
        """
        poses = self._model.link_poses(q)
        distances, height = self._outer(poses)
        clearances = np.empty((len(q), len(PostureRule)))
        clearances[:, PostureRule.WORKSPACE] = distances.min(axis=(1, 2, 3))
        clearances[:, PostureRule.TABLE] = height - self._lowest_height
        clearances[:, PostureRule.SELF_COLLISION] = self._checker.self_clearance(poses)
        clearances[:, PostureRule.SELF_COLLISION] -= self._config.self_margin
        return clearances

    def _joint_reaches(self) -> np.ndarray:
        """Returns for each joint a bound (7,) [m] on the distance from its axis to points it moves.

        A bound adds up the lengths of all links between the joint and such a point.
        """
        extents = np.linalg.norm(self._centers[:, :3], axis=1) + self._radii[:, 0]
        extents = np.concatenate([np.zeros(_FIRST_LINK - 1), extents.max(axis=1)])
        lengths = np.concatenate([[0.0], np.cumsum(self._model.link_lengths[1:])])
        return np.array([(lengths + extents)[k:].max() - lengths[k] for k in range(NUM_JOINTS)])

    def largest_displacement(self, turns: np.ndarray) -> float:
        """Returns an upper bound on how far any point of the arm moves [m].

        The distance between two points of the arm changes by no more than the bound, too.

        Args:
            turns: (B, 7) changes of the joint positions [rad]; the bound covers all B.
        """
        return float((np.abs(turns) @ self._reaches).max())

    def face_distances(self, q: np.ndarray) -> np.ndarray:
        """Returns how far each posture is inside each face of the boxes, (B, 12) [m].

        A distance is negative beyond its face; the smallest is the first column of `clearances`.
        The columns are ordered by side (lower, upper), then body (gripper, arm), then axis.

        Args:
            q: (B, 7) joint positions [rad].
        """
        return self._outer(self._model.link_poses(q))[0].reshape(len(q), 12)

    def tightest_face(self, q: np.ndarray) -> str:
        """Returns a clause on the face of a box that the postures come closest to or exceed most.

        Args:
            q: (B, 7) joint positions [rad], at least one.
        """
        distances = self.face_distances(q)
        nearest = int(np.argmin(distances.min(axis=0)))
        side, body, axis = np.unravel_index(nearest, (2, 2, 3))
        name = f"{('gripper', 'body')[body]}_{('lower', 'upper')[side]}"
        limit = getattr(self._config, name)[axis]
        distance = 1e3 * float(distances.min())
        where = f"{distance:.1f} mm from" if distance >= 0.0 else f"{-distance:.1f} mm beyond"
        part = ("gripper", "arm")[body]
        return f"the {part} is {where} poil.safety.posture.{name}[{axis}], {limit:g} m"

    def tightest(self, q: np.ndarray) -> str:
        """Returns a clause on the rule that the posture `q` (7,) [rad] is closest to breaking."""
        rule = PostureRule(int(np.argmin(self.clearances(q[None])[0])))
        if rule is PostureRule.WORKSPACE:
            return self.tightest_face(q[None])
        if rule is PostureRule.SELF_COLLISION:
            return "the wrist or the hand is close to the shoulder"
        _, height = self._outer(self._model.link_poses(q[None]))
        table = self._lowest_height - self._config.table_margin
        clearance = 1e3 * (height[0] - table)
        where = "above" if clearance >= 0.0 else "below"
        return f"the arm is {abs(clearance):.1f} mm {where} the table's top"

    def _outer(self, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns the distances to the boxes' faces (B, 2, 2, 3) [m], and the lowest height (B,).

        The distances are indexed by side (lower, upper), body (gripper point, arm) and axis.
        """
        gripper = poses[:, GRIPPER_LINK, :3, 3]
        points = poses[:, _FIRST_LINK:, :3] @ self._centers
        lowest = np.stack([gripper, (points - self._radii).min(axis=(1, 3))], axis=1)
        highest = np.stack([gripper, (points + self._radii).max(axis=(1, 3))], axis=1)
        faces = np.stack([lowest - self._lower, self._upper - highest], axis=1)
        return faces, lowest[:, 1, 2]

    def broken_rule(self, q: np.ndarray, present: np.ndarray) -> PostureRule | None:
        """Returns the first rule that any of the postures breaks, or None.

        If `present` already breaks a rule, a posture breaks it only if its clearance is smaller.

        Args:
            q: (B, 7) next postures [rad].
            present: (7,) current posture [rad], or (B, 7), one for each next posture.
        """
        clearances = self.clearances(q)
        if clearances.min() >= 0.0:
            return None
        allowed = np.minimum(0.0, self.clearances(np.atleast_2d(present))) - _ROUNDING
        broken = (clearances < allowed).any(axis=0)
        return PostureRule(int(np.argmax(broken))) if broken.any() else None


def _outline(spheres: RobotSpheres, gripper: GripperGeometry) -> tuple[np.ndarray, np.ndarray]:
    """Returns homogeneous centres (7, 4, P) and radii (7, 1, P) for links 2 to 7 and the hand.

    Spheres are repeated until every link has P. The hand's are its corners, with radius zero.
    """
    corners = _hand_corners(gripper)
    own = [np.flatnonzero(spheres.links == link) for link in range(_FIRST_LINK, GRIPPER_LINK)]
    size = max(len(corners), *map(len, own))
    own = [np.resize(indices, size) for indices in own]
    centers = [*spheres.centers[own], np.resize(corners, (size, 3))]
    radii = [*spheres.radii[own], np.zeros(size)]
    points = np.concatenate([centers, np.ones((len(centers), size, 1))], axis=-1)
    return np.swapaxes(points, -1, -2).copy(), np.array(radii)[:, None]


def _hand_corners(gripper: GripperGeometry) -> np.ndarray:
    """Returns the corners (12, 3) of the hand's box and of the closed fingers' ends [m], in G."""
    x, y, z = (np.ravel(values) for values in np.meshgrid(*zip(*gripper.hand_box(), strict=True)))
    half, thickness, end = 0.5 * gripper.finger_width, gripper.tip_thickness, gripper.tip_end
    tips = [(i * half, j * thickness, end) for i in (-1, 1) for j in (-1, 1)]
    return np.concatenate([np.stack([x, y, z], axis=1), tips])
