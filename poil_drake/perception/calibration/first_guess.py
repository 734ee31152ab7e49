"""First guesses of poses from single images of a calibration board, in closed form."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from poil_drake.errors import CalibrationError
from poil_drake.geometry.rigid_transform import inverse, make_transform, rotation_log
from poil_drake.perception.calibration.board import CalibrationBoard
from poil_drake.perception.images import CameraModel

_AMBIGUITY = 1.5
"""A board's pose is unambiguous if its mirrored pose fits worse by this factor."""

Poses = tuple[dict[str, np.ndarray], dict[int, np.ndarray], np.ndarray]
"""Poses X_WC by camera, X_WB by view, and X_GB."""


@dataclass(frozen=True, eq=False)
class BoardView:
    """The board's corners in one image.

    Attributes:
        camera: Name of the camera.
        view: Number of the view, 0 to V - 1.
        corners: (K,) indices of the corners.
        pixels: (K, 2) their pixels.
        name: The image's name, for messages.
    """

    camera: str
    view: int
    corners: np.ndarray
    pixels: np.ndarray
    name: str = ""


def first_guess(
    cameras: Sequence[CameraModel],
    views: Sequence[BoardView],
    board: CalibrationBoard,
    hand_poses: np.ndarray | None,
    known: Mapping[str, np.ndarray],
) -> Poses:
    """Returns poses from the board's pose in each image, without minimizing errors."""
    K = {camera.name: camera.K for camera in cameras}
    solved = [(view, *_board_in_camera(view, K[view.camera], board)) for view in views]
    found, boards, X_GB = dict(known), dict[int, np.ndarray](), np.eye(4)
    if hand_poses is not None:
        # The camera with the most unambiguous views gives the board's pose on the hand.
        clear = {
            c.name: [(v, X) for v, X, ok in solved if ok and v.camera == c.name] for c in cameras
        }
        name = max(clear, key=lambda name: len(clear[name]))
        pairs = clear[name]
        if len(pairs) < 3:
            pairs = [(view, X) for view, X, _ in solved if view.camera == name]
        X_GB, _ = robot_world_hand_eye(
            hand_poses[[view.view for view, _ in pairs]], np.stack([X for _, X in pairs])
        )
        boards = {view.view: hand_poses[view.view] @ X_GB for view in views}
    while True:  # Known cameras locate boards, and known boards locate cameras.
        before = len(found) + len(boards)
        for view, X_CB, _ in sorted(solved, key=lambda item: not item[2]):
            if view.camera in found and view.view not in boards:
                boards[view.view] = found[view.camera] @ X_CB
        for camera in cameras:
            if camera.name not in found:
                guesses = [
                    boards[view.view] @ inverse(X_CB)
                    for view, X_CB, _ in solved
                    if view.camera == camera.name and view.view in boards
                ]
                if guesses:
                    found[camera.name] = _middle(np.stack(guesses))
        if len(found) + len(boards) == before:
            break
    if missing := [camera.name for camera in cameras if camera.name not in found]:
        raise CalibrationError(
            f"No view connects camera '{missing[0]}' with {', '.join(known)}.",
            remedy="Take views in which both see the board, or which connect them through others.",
        )
    return found, boards, X_GB


def _board_in_camera(
    view: BoardView, K: np.ndarray, board: CalibrationBoard
) -> tuple[np.ndarray, bool]:
    """Returns X_CB (4, 4) of one image, and whether its mirrored pose fits clearly worse."""
    count, rotations, translations, errors = cv2.solvePnPGeneric(
        board.corners[view.corners], view.pixels, K, None, flags=cv2.SOLVEPNP_IPPE
    )
    X = make_transform(cv2.Rodrigues(rotations[0])[0], translations[0].ravel())
    clear = count == 1 or float(errors[1].item()) > _AMBIGUITY * float(errors[0].item())
    return X, clear


def _middle(poses: np.ndarray) -> np.ndarray:
    """Returns the pose (4, 4) among (P, 4, 4) with the least summed distance to the others."""
    arms = np.linalg.norm(poses[:, None, :3, 3] - poses[None, :, :3, 3], axis=-1)
    turns = rotation_log(np.swapaxes(poses[:, None, :3, :3], -1, -2) @ poses[None, :, :3, :3])
    return poses[np.argmin((arms + np.linalg.norm(turns, axis=-1)).sum(axis=1))]


def robot_world_hand_eye(X_WG: np.ndarray, X_CB: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns X_GB and X_WC with X_WG X_GB = X_WC X_CB, in the least-squares sense.

    Shah (2013): the rotations are the dominant singular vectors of a sum of Kronecker products;
    the translations then solve a linear problem. OpenCV 5.0 lacks its own function in Python.

    Args:
        X_WG: (V, 4, 4) poses of the hand [m].
        X_CB: (V, 4, 4) poses of the board in the camera [m]. The hand must turn about two axes.
    """
    R_G, R_B = X_WG[:, :3, :3], X_CB[:, :3, :3]
    # With column-major vec, R_G X R_B^T = Z is (R_B kron R_G) vec X = vec Z.
    products = np.einsum("vab,vcd->acbd", R_B, R_G).reshape(9, 9)
    left, _, right = np.linalg.svd(products)
    R_GB, R_WC = (_nearest_rotation(v.reshape(3, 3).T) for v in (right[0], left[:, 0]))
    count = len(X_WG)
    A = np.concatenate([R_G, np.broadcast_to(-np.eye(3), (count, 3, 3))], axis=2).reshape(-1, 6)
    b = (X_CB[:, :3, 3] @ R_WC.T - X_WG[:, :3, 3]).ravel()
    t = np.linalg.lstsq(A, b, rcond=None)[0]
    return make_transform(R_GB, t[:3]), make_transform(R_WC, t[3:])


def _nearest_rotation(M: np.ndarray) -> np.ndarray:
    """Returns the rotation nearest to M (3, 3), which is known up to a factor of either sign."""
    U, _, Vt = np.linalg.svd(M * np.sign(np.linalg.det(M)))
    return U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
