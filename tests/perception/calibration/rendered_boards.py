"""Views of a calibration board: exact corners, and images with blur and noise."""

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from poil_drake.geometry.depth_image import project
from poil_drake.geometry.rigid_transform import inverse, make_transform, transform_points
from poil_drake.perception.calibration.board import CalibrationBoard
from poil_drake.perception.calibration.first_guess import BoardView
from poil_drake.perception.images import CameraModel

WIDTH, HEIGHT = 640, 480
BOARD = CalibrationBoard()
X_GB = make_transform(
    Rotation.from_euler("xyz", [3.0, -2.0, 40.0], degrees=True).as_matrix(), [-0.13, -0.09, 0.02]
)
"""The board on the hand, roughly centred."""

_PIXELS_PER_SQUARE = 80
_OVERSAMPLING = 3


def looking_at(position: np.ndarray, target: np.ndarray, roll: float = 0.0) -> np.ndarray:
    """Returns the pose of an optical frame that looks at a target."""
    z = np.subtract(target, position) / np.linalg.norm(np.subtract(target, position))
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    R = np.stack([x, np.cross(z, x), z], axis=1) @ Rotation.from_euler("z", roll).as_matrix()
    return make_transform(R, np.asarray(position, dtype=float))


def cameras(*names: str) -> tuple[CameraModel, ...]:
    """Returns cameras on an arc around the workspace, as in the package's scene."""
    K = np.array([[566.0, 0.0, 322.0], [0.0, 565.0, 237.0], [0.0, 0.0, 1.0]])
    angles = np.deg2rad([35.0, -40.0, 75.0, -80.0][: len(names)])
    return tuple(
        CameraModel(
            name,
            WIDTH,
            HEIGHT,
            K,
            looking_at(
                [0.45 + 0.55 * np.cos(a), 0.6 * np.sin(a), 0.62], [0.45, 0.0, 0.2], roll=0.1 * a
            ),
        )
        for name, a in zip(names, angles, strict=True)
    )


def board_poses(count: int, *, seed: int = 0, tilt: float = 25.0) -> np.ndarray:
    """Returns poses X_WB whose board faces the cameras, tilted by about `tilt` degrees."""
    rng = np.random.default_rng(seed)
    # The board's z axis points into it, so a board that faces up and to +x is turned about y.
    facing = Rotation.from_euler("xyz", [180.0, 35.0, 0.0], degrees=True)
    poses = []
    for _ in range(count):
        turn = Rotation.from_rotvec(np.deg2rad(tilt) * rng.normal(size=3) * [0.7, 0.7, 1.0])
        R = (facing * turn).as_matrix()
        centre = np.array([0.45, 0.0, 0.2]) + rng.uniform(-0.07, 0.07, size=3)
        poses.append(make_transform(R, centre - R @ BOARD.corners.mean(axis=0)))
    return np.stack(poses)


def exact_views(
    models: tuple[CameraModel, ...], poses: np.ndarray, *, noise: float = 0.0, seed: int = 1
) -> list[BoardView]:
    """Returns the corners of each pose in each camera, with Gaussian noise [px]."""
    rng = np.random.default_rng(seed)
    views = []
    for number, X_WB in enumerate(poses):
        for model in models:
            pixels, _ = project(transform_points(X_WB, BOARD.corners), model.K, model.X_WC)
            inside = ((pixels > 5) & (pixels < [WIDTH - 6, HEIGHT - 6])).all(axis=1)
            if inside.sum() >= 6:
                corners = np.flatnonzero(inside)
                noisy = pixels[corners] + noise * rng.normal(size=(len(corners), 2))
                views.append(BoardView(model.name, number, corners, noisy))
    return views


def rendered(model: CameraModel, X_WB: np.ndarray, *, seed: int = 0) -> np.ndarray:
    """Returns an image (H, W, 3) of the board before a grey wall, with blur, shading and noise."""
    n, s = _PIXELS_PER_SQUARE, _OVERSAMPLING
    size = (BOARD.columns * n, BOARD.rows * n)
    print_ = cv2.copyMakeBorder(
        BOARD._board.generateImage(size), n, n, n, n, cv2.BORDER_CONSTANT, value=255
    )
    # Pixel (i, j) of the print is centred on ((i - n + 0.5) / n, ...) squares.
    to_metres = np.array([[1, 0, 0.5 - n], [0, 1, 0.5 - n], [0, 0, n / BOARD.square]])
    X_CB = inverse(model.X_WC) @ X_WB
    H = model.K @ X_CB[:3, [0, 1, 3]] @ to_metres / (n / BOARD.square)
    fine = np.array([[s, 0, (s - 1) / 2], [0, s, (s - 1) / 2], [0, 0, 1]])
    large = cv2.warpPerspective(
        print_, fine @ H, (s * WIDTH, s * HEIGHT), borderValue=110, flags=cv2.INTER_AREA
    )
    gray = cv2.resize(large, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA).astype(float)
    rng = np.random.default_rng(seed)
    shade = np.linspace(0.55, 0.85, WIDTH)[None]
    gray = cv2.GaussianBlur(20.0 + gray * shade, (0, 0), 0.8) + rng.normal(size=gray.shape) * 4.0
    return np.repeat(np.clip(gray, 0, 255).astype(np.uint8)[:, :, None], 3, axis=2)
