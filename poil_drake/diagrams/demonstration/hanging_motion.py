"""The default demonstration: an object with a handle is hung on a rod."""

import numpy as np
from pydrake.math import RotationMatrix

from poil_drake.diagrams.demonstration.scene import DemonstrationScene
from poil_drake.diagrams.scenario.demonstration_config import HangingMotionConfig
from poil_drake.errors import ScenarioError
from poil_drake.geometry.rigid_transform import make_transform

_STEEPEST_ROD = 0.9  # Sine of the angle from the horizontal; handles slide off steeper rods.

_REST = 0.5  # [s] at the start and at the end, as people rest
_LIFT = 1.0  # [s]
_CARRY = 3.0  # [s]; keeps turning and tilting below 1 rad/s
_SLIDE = 1.5  # [s]; the handle over the rod
_LOWER = 0.75  # [s]; the handle onto the rod


def hanging_keyframes(
    scene: DemonstrationScene, config: HangingMotionConfig
) -> tuple[np.ndarray, np.ndarray]:
    """Returns keyframes that hang the scene's object on the rod of its fixture.

    At the start the object stands on the table with its z axis up; its handle is the scenario's
    functional part. The object is lifted, carried to the rod's tip, slid onto the rod and lowered.

    Returns:
        (K,) times [s] and (K, 4, 4) poses of the object in the world [m].

    Raises:
        ScenarioError: The fixture has no suitable rod, or the object has no suitable handle.
    """
    base, tip = _find_rod(scene, config)
    rod = _direction(base, tip)
    opening, handle = _find_handle(scene)
    seat = base + config.seat * (tip - base)
    ahead = _direction_ahead(rod, seat - scene.robot_position)
    turn = _heading(ahead) - _heading(handle) + np.radians(config.start_yaw)
    start = _standing(scene, RotationMatrix.MakeZRotation(turn).matrix(), config)
    lifted = make_transform(start[:3, :3], start[:3, 3] + [0.0, 0.0, config.lift])
    R = _hanging_rotation(rod, handle, ahead, config.tilt)
    over = make_transform(R, seat - R @ opening)
    before = make_transform(R, over[:3, 3] + (tip + config.approach * rod - seat))
    hung = make_transform(R, over[:3, 3] + _descent(scene, over, rod, config))
    times = np.cumsum([0.0, _REST, _LIFT, _CARRY, _SLIDE, _LOWER, _REST])
    return times, np.array([start, start, lifted, before, over, hung, hung])


def _standing(
    scene: DemonstrationScene, rotation: np.ndarray, config: HangingMotionConfig
) -> np.ndarray:
    """Returns the pose (4, 4) at which the object stands first [m, world]."""
    position = np.append(config.start or scene.object_position[:2], 0.0)[:3]
    if len(config.start) < 3:
        lowest = scene.lowest_point(make_transform(rotation, position))
        position[2] = scene.table_height - lowest
    return make_transform(rotation, position)


def _heading(direction: np.ndarray) -> float:
    """Returns the angle of a horizontal direction (3,) from the x axis [rad]."""
    return float(np.arctan2(direction[1], direction[0]))


def _direction(base: np.ndarray, tip: np.ndarray) -> np.ndarray:
    return (tip - base) / np.linalg.norm(tip - base)


def _find_rod(
    scene: DemonstrationScene, config: HangingMotionConfig
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the ends of the rod's axis, base and tip, each (3,) [m, world]."""
    fixture = scene.fixture_name
    boxes = scene.boxes(fixture, config.rod)
    if not boxes:
        raise _unsuitable(
            f"The fixture '{fixture}' has no link or collision geometry '{config.rod}'.",
            "Set poil.demonstration_motion.hanging.rod to one of "
            f"{scene.collision_choices(fixture)}",
        )
    X_WB, half = max(boxes, key=lambda box: float(np.max(box[1])))
    axis = int(np.argmax(half))
    # Nothing hangs on a rounded end: the axis ends a radius before it.
    reach = (half[axis] - np.min(half)) * X_WB[:3, axis]
    ends = [X_WB[:3, 3] - reach, X_WB[:3, 3] + reach]
    foot = scene.model_position(fixture)
    base, tip = sorted(ends, key=lambda end: float(np.linalg.norm((end - foot)[:2])))
    steepness = abs(_direction(base, tip)[2])
    if steepness > _STEEPEST_ROD:
        raise _unsuitable(
            f"The rod '{config.rod}' of '{fixture}' is too steep for a handle to stay on it: "
            f"{np.degrees(np.arcsin(steepness)):.0f} deg from the horizontal.",
            "Set poil.demonstration_motion.hanging.rod to another link",
        )
    return base, tip


def _find_handle(scene: DemonstrationScene) -> tuple[np.ndarray, np.ndarray]:
    """Returns the centre of the handle's opening [m] and the handle's direction from the z axis.

    Both are (3,), in the object's frame.
    """
    scene.put_object(np.eye(4))
    boxes = scene.boxes(scene.object_name, scene.part_link)
    if not boxes:
        raise _unsuitable(
            f"The part '{scene.part_link}' of the demonstration's object has no collision "
            "geometry with which it could hang on the rod.",
            "Set the part in poil.parts to one of what collides: "
            f"{scene.collision_choices(scene.object_name)}; the expression must match the part's "
            "visual geometries, too",
        )
    signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, 8).T
    corners = np.concatenate([X[:3, 3] + (signs * half) @ X[:3, :3].T for X, half in boxes])
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    outward = np.array([middle[0], middle[1], 0.0])
    if np.linalg.norm(outward) < 1e-3:
        raise _unsuitable(
            f"The part '{scene.part_link}' of the demonstration's object lies on the object's z "
            "axis, so it is not a handle.",
            "Choose another poil.part",
        )
    direction = outward / np.linalg.norm(outward)
    along = corners @ direction
    opening = direction * (along.min() + along.max()) / 2 + [0.0, 0.0, middle[2]]
    return opening, direction


def _unsuitable(problem: str, remedy: str) -> ScenarioError:
    return ScenarioError(problem, remedy=f"{remedy}, or set poil.demonstration_motion.keyframes.")


def _direction_ahead(rod: np.ndarray, away: np.ndarray) -> np.ndarray:
    """Returns the horizontal unit vector (3,) perpendicular to the rod that points away."""
    ahead = np.cross(rod, [0.0, 0.0, 1.0])
    ahead /= np.linalg.norm(ahead)
    return ahead * (np.sign(ahead @ away) or 1.0)


def _hanging_rotation(
    rod: np.ndarray, handle: np.ndarray, ahead: np.ndarray, tilt: float
) -> np.ndarray:
    """Returns the object's (3, 3) orientation in the world when its handle hangs on the rod.

    Args:
        rod: Unit vector (3,) along the rod in the world.
        handle: Unit vector (3,) from the object's z axis to its handle, in the object's frame.
        ahead: `_direction_ahead`, in which the handle points, away from the robot.
        tilt: Elevation of the handle above the horizontal [deg].
    """
    up = np.array([0.0, 0.0, 1.0]) - rod[2] * rod
    up /= np.linalg.norm(up)
    angle = np.radians(tilt)
    pointing = np.cos(angle) * ahead + np.sin(angle) * up
    upright = np.cos(angle) * up - np.sin(angle) * ahead
    world = np.column_stack([pointing, np.cross(upright, pointing), upright])
    z = np.array([0.0, 0.0, 1.0])
    own = np.column_stack([handle, np.cross(z, handle), z])
    return world @ own.T


def _descent(
    scene: DemonstrationScene, over: np.ndarray, rod: np.ndarray, config: HangingMotionConfig
) -> np.ndarray:
    """Returns the displacement (3,) [m, world] that lowers the object from its pose `over`.

    The displacement is perpendicular to the rod, and leaves a gap of `clearance` to the handle.
    """
    down = rod[2] * rod - np.array([0.0, 0.0, 1.0])
    down /= np.linalg.norm(down)

    def gap(depth: float) -> float:
        pose = make_transform(over[:3, :3], over[:3, 3] + depth * down)
        return scene.distance(pose, scene.part_link, scene.fixture_name, config.rod)

    if gap(0.0) < config.clearance:
        raise _unsuitable(
            f"The gap between rod and handle is {1000 * gap(0.0):.1f} mm, less than "
            f"poil.demonstration_motion.hanging.clearance, {1000 * config.clearance:.1f} mm.",
            "Use a thinner rod, a larger handle or a smaller clearance",
        )
    low, high = 0.0, config.clearance
    while gap(high) > config.clearance:
        low, high = high, high + 0.002
        if high > 0.2:
            raise _unsuitable(
                f"The part '{scene.part_link}' has no opening with which it can hang on the rod.",
                "Choose another poil.part",
            )
    for _ in range(30):
        middle = (low + high) / 2
        low, high = (middle, high) if gap(middle) > config.clearance else (low, middle)
    return low * down
