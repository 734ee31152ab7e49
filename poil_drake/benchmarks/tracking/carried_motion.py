"""The motion of arm and object in a benchmark sequence: a hand takes a mug and hangs it."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from poil_drake.diagrams.demonstration.hanging_motion import hanging_keyframes
from poil_drake.diagrams.demonstration.motion import KeyframeMotion, minimum_jerk
from poil_drake.diagrams.demonstration.scene import DemonstrationScene
from poil_drake.diagrams.scenario.randomization import ObjectDirective
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_transform import inverse, make_transform
from poil_drake.models.mug_family import NAMED_MUGS, MugParameters
from poil_drake.robots.inverse_kinematics import distinct_solutions, solve_inverse_kinematics
from poil_drake.robots.panda import MAX_HAND_WIDTH
from poil_drake.robots.panda_kinematics import PandaModel

_REST = 0.5  # [s] before the arm moves: the tracker starts on an object that nothing hides
_REACH = 2.0  # [s] from the start posture to the grasp
_PREGRASP = 0.1  # [m] back from the grasp
_FINGERS_BELOW_RIM = 0.02  # [m]
_RIM_ANGLES = np.radians(np.arange(45.0, 316.0, 30.0))  # of grasps, clear of the handle at 0
_LARGEST_STEP = 0.3  # of a joint between two frames [rad]: a jump to another branch of the IK

SLIP_LENGTH, SLIP_ANGLE = 0.03, 20.0
"""How far the object slips in the hand [m] and [deg]."""


@dataclass(frozen=True, eq=False)
class CarriedMotion:
    """Arm, hand and object at T times.

    Attributes:
        times: (T,) [s].
        postures: (T, 7) joint positions of the arm [rad].
        widths: (T,) opening of the hand [m].
        hand_poses: (T, 4, 4) X_WG.
        object_poses: (T, 4, 4) X_WO.
        held: (T,) bool, whether the hand holds the object.
        priors: (T, 4, 4) X_M, the motion of the object as forward kinematics knows it: with the
            hand since the moment of the grasp, and none before.
        carried: First and last time of the transport through the air [s].
    """

    times: np.ndarray
    postures: np.ndarray
    widths: np.ndarray
    hand_poses: np.ndarray
    object_poses: np.ndarray
    held: np.ndarray
    priors: np.ndarray
    carried: tuple[float, float]


def hanging_motion(
    scenario: Scenario, *, X_WO: np.ndarray, model: PandaModel, home: np.ndarray
) -> CarriedMotion:
    """Returns the motion that takes the scenario's mug by its rim and hangs it on the rack.

    Args:
        scenario: The scenario, whose object is one of the package's mugs.
        X_WO: (4, 4) where the mug stands.
        model: The arm.
        home: (7,) where the arm starts [rad].

    Raises:
        InvalidValueError: if no grasp of the rim reaches all of the motion.
    """
    period = scenario.poil.rates.tracker
    moments, poses = _keyframes(scenario, X_WO)
    motion = KeyframeMotion(moments, poses, blend=scenario.poil.demonstration_motion.blend)
    path = np.array([motion.pose(t) for t in np.arange(0.0, motion.duration, period)])
    mug = _mug(scenario)
    arm, X_OG = _reachable(model, path, _rim_grasps(mug))
    above = X_WO @ X_OG
    above = make_transform(above[:3, :3], above[:3, 3] - _PREGRASP * above[:3, 2])
    pregrasp, reached = solve_inverse_kinematics(model, above[None], arm[:1])
    if not reached.all():
        raise InvalidValueError("The arm does not reach the pregrasp.", remedy="Use another seed.")
    rest, reach = round(_REST / period), round(_REACH / period)
    share = minimum_jerk(np.arange(reach) / reach)[:, None]
    via = np.where(share < 0.7, share / 0.7, (share - 0.7) / 0.3)
    to_grasp = np.where(
        share < 0.7, home + via * (pregrasp - home), pregrasp + via * (arm[0] - pregrasp)
    )
    postures = np.concatenate([np.tile(home, (rest, 1)), to_grasp, arm])
    before = rest + reach
    held = np.arange(len(postures)) >= before
    hand_poses = model.gripper_pose(postures)
    # What the arm does, which reaches the path but for the tolerance of its kinematics.
    carried = hand_poses @ inverse(hand_poses[before])
    priors = np.where(held[:, None, None], carried, np.eye(4))
    return CarriedMotion(
        times=period * np.arange(len(postures)),
        postures=postures,
        widths=np.where(held, mug.wall, MAX_HAND_WIDTH),
        hand_poses=hand_poses,
        object_poses=priors @ X_WO,
        held=held,
        priors=priors,
        carried=(period * before + moments[1], period * before + moments[2]),
    )


def still_motion(
    scenario: Scenario, *, X_WO: np.ndarray, model: PandaModel, home: np.ndarray, duration: float
) -> CarriedMotion:
    """Returns a standing object and an arm at rest, for a duration [s]."""
    period = scenario.poil.rates.tracker
    count = round(duration / period)
    postures = np.tile(home, (count, 1))
    return CarriedMotion(
        times=period * np.arange(count),
        postures=postures,
        widths=np.full(count, MAX_HAND_WIDTH),
        hand_poses=model.gripper_pose(postures),
        object_poses=np.tile(X_WO, (count, 1, 1)),
        held=np.zeros(count, dtype=bool),
        priors=np.tile(np.eye(4), (count, 1, 1)),
        carried=(0.0, duration),
    )


def with_slip(motion: CarriedMotion, time: float, rng: np.random.Generator) -> CarriedMotion:
    """Returns the motion with a slip in the hand between two frames, in a random direction.

    The object moves by 3 cm and turns by 20 deg about its frame's origin.

    Args:
        motion: The motion.
        time: When the object has slipped [s].
        rng: Draws the slip.
    """
    axis, direction = rng.standard_normal((2, 3))
    turn = Rotation.from_rotvec(np.radians(SLIP_ANGLE) * axis / np.linalg.norm(axis))
    slip = make_transform(turn.as_matrix(), SLIP_LENGTH * direction / np.linalg.norm(direction))
    late = (motion.times >= time)[:, None, None]
    poses = np.where(late, motion.object_poses @ slip, motion.object_poses)
    return replace(motion, object_poses=poses)


def _keyframes(scenario: Scenario, X_WO: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns times and poses of the built-in demonstration from X_WO on, without its rest."""
    model = ObjectDirective(list(scenario.directives), scenario.poil.object)
    poil = replace(scenario.poil, demonstration_object=model.file)
    scene = DemonstrationScene(replace(scenario, poil=poil), cameras=False)
    moments, poses = hanging_keyframes(scene, poil.demonstration_motion.hanging)
    lifted = X_WO.copy()
    lifted[2, 3] += poil.demonstration_motion.hanging.lift
    poses[1], poses[2] = X_WO, lifted
    return moments[1:] - moments[1], poses[1:]


def _mug(scenario: Scenario) -> MugParameters:
    name = Path(ObjectDirective(list(scenario.directives), scenario.poil.object).file).stem
    return next(mug for mug in NAMED_MUGS if mug.name == name)


def _rim_grasps(mug: MugParameters) -> np.ndarray:
    """Returns poses X_OG (B, 4, 4) that take the mug's wall between the fingers from above."""
    grasps = []
    for angle in _RIM_ANGLES:
        radial = np.array([np.cos(angle), np.sin(angle), 0.0])
        point = (mug.radius - mug.wall / 2) * radial + [0, 0, mug.height - _FINGERS_BELOW_RIM]
        for closing in (radial, -radial):
            down = np.array([0.0, 0.0, -1.0])
            rotation = np.column_stack([np.cross(closing, down), closing, down])
            grasps.append(make_transform(rotation, point))
    return np.array(grasps)


def _reachable(
    model: PandaModel, path: np.ndarray, grasps: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns postures (T, 7) that carry the object along a path (T, 4, 4), and the grasp X_OG.

    Of the grasps (B, 4, 4), the one whose largest step is smallest is chosen.

    Raises:
        InvalidValueError: if there is none.
    """
    q, index = distinct_solutions(model, path[-1] @ grasps)
    X_OG, found = grasps[index], q[:, None]
    for X_WO in path[-2::-1]:
        q, reached = solve_inverse_kinematics(model, X_WO @ X_OG, found[:, 0])
        reached &= np.abs(q - found[:, 0]).max(axis=1, initial=0.0) <= _LARGEST_STEP
        found, X_OG = np.concatenate([q[:, None], found], axis=1)[reached], X_OG[reached]
    if not len(found):
        raise InvalidValueError(
            "No grasp of the mug's rim reaches the whole motion.", remedy="Use another seed."
        )
    best = int(np.argmin(np.abs(np.diff(found, axis=1)).max(axis=(1, 2))))
    return found[best], X_OG[best]
