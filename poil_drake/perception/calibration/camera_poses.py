"""Estimates the poses of fixed cameras from views of one calibration board.

Each view v has one pose of the board. Camera c observes the board's corners p at the pixels

    u_cvk = project(K_c, X_WCc^-1 X_WBv p_k).

If the board is on the robot's hand, X_WBv = X_WGv X_GB, where the gripper's poses X_WGv are known
and X_GB is not ("eye to hand"). If the board is loose, every X_WBv is unknown, and the pose of one
camera is kept. All unknown poses minimize the squared reprojection errors of all cameras together.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from poil_drake.errors import CalibrationError
from poil_drake.geometry.rigid_transform import (
    inverse,
    make_transform,
    rotation_exp,
    rotation_log,
    transform_points,
)
from poil_drake.perception.calibration.board import CalibrationBoard
from poil_drake.perception.calibration.first_guess import BoardView, Poses, first_guess
from poil_drake.perception.images import CameraModel

_FEWEST_VIEWS = 6
"""Views in which a camera must see a board on the hand; fewer leave no redundancy."""

_FEWEST_LOOSE_VIEWS = 3
"""Views in which a camera must see a loose board together with another camera."""

_LEAST_TURN = np.deg2rad(10.0)
"""RMS angle by which the hand must turn about a second axis. A hand that turns about one axis only
leaves the board's place along that axis unknown."""

_OUTLIER_FACTOR, _LEAST_OUTLIER = 4.0, 1.0
"""An image is left out if its RMS error exceeds this multiple of the median and this error [px];
one corner, if its error exceeds this multiple of its image's median."""

_LARGEST_LEFT_OUT = 0.25
"""Largest fraction of views that may be left out."""

_MOST_STEPS = 50
"""Largest number of steps of a minimization; good views need 5 to 15, others end as a misfit."""

_LARGEST_RESCALING = 0.01
"""Largest accepted relative error of the board's size."""

_LARGEST_RMS = 3.0
"""Largest accepted RMS reprojection error [px]; good cameras and arms reach 0.1 to 1."""


@dataclass(frozen=True, eq=False)
class CameraCalibration:
    """The result for one camera.

    Attributes:
        X_WC: (4, 4) pose of the optical frame in the world [m].
        rms: RMS reprojection error [px].
        position_error: Estimated standard error of the position [m], root of the summed variances;
            0 if the pose was kept.
        rotation_error: Estimated standard error of the rotation [rad]; likewise.
    """

    X_WC: np.ndarray
    rms: float
    position_error: float
    rotation_error: float


@dataclass(frozen=True, eq=False)
class CalibrationResult:
    """The result for all cameras.

    Attributes:
        cameras: Name -> result.
        boards: View -> (4, 4) pose X_WB of the board [m], for each view that was used.
        left_out: Images that do not fit the others.
        square: Edge of the squares that fits the hand's motions best [m], NaN for a loose board.
    """

    cameras: Mapping[str, CameraCalibration]
    boards: Mapping[int, np.ndarray]
    left_out: tuple[BoardView, ...]
    square: float = np.nan


def calibrate_cameras(
    cameras: Sequence[CameraModel],
    views: Sequence[BoardView],
    board: CalibrationBoard,
    *,
    hand_poses: np.ndarray | None = None,
    kept: str | None = None,
) -> CalibrationResult:
    """Returns the poses of the cameras.

    The standard errors are those of a jackknife, which leaves out one view after another. Unlike
    the noise of the corners alone, they include errors that a view's corners share, such as those
    of the arm's kinematics.

    Args:
        cameras: The cameras to calibrate; their intrinsics count, their poses only if kept.
        views: The images in which the board was found.
        board: The board.
        hand_poses: (V, 4, 4) poses X_WG of the hand that holds the board [m]; None for a loose
            board.
        kept: For a loose board, the camera whose pose is known.

    Raises:
        CalibrationError: if there are too few views, if the hand turns too little, or if the views
            do not fit one board.
    """
    _check_views(cameras, views, hand_poses, kept)
    known = {} if kept is None else {c.name: c.X_WC for c in cameras if c.name == kept}
    free = [camera.name for camera in cameras if camera.name not in known]
    start = first_guess(cameras, views, board, hand_poses, known)
    problem = _Reprojection(cameras, views, board, hand_poses, start, free)
    # An image that does not fit, e.g. one of a moving arm, must not spoil the others.
    x = _minimize(problem.errors, problem.zero, "soft_l1").x
    square = np.nan if hand_poses is None else _fitting_square(problem, x, board.config.square)
    errors = problem.image_rms(x)
    fits = errors <= max(_OUTLIER_FACTOR * float(np.median(errors)), _LEAST_OUTLIER)
    left_out = tuple(view for view, ok in zip(views, fits, strict=True) if not ok)
    if np.median(errors) > _LARGEST_RMS or len(left_out) > _LARGEST_LEFT_OUT * len(views):
        raise _misfit(float(np.median(errors)), len(left_out), len(views), hand_poses is not None)
    good = [view for view, ok in zip(problem.without_outliers(views, x), fits, strict=True) if ok]
    _check_views(cameras, good, hand_poses, kept)

    problem = _Reprojection(cameras, good, board, hand_poses, problem.poses(x), free)
    solution = _minimize(problem.errors, problem.zero, "linear")
    spread = _jackknife(solution.jac, solution.fun, problem.view_of_row).reshape(-1, 6)
    variances = {name: spread[k] for k, name in enumerate(free)}
    found, boards, _ = problem.poses(solution.x)
    rms = problem.image_rms(solution.x)

    def calibration(name: str) -> CameraCalibration:
        own = [error for error, view in zip(rms, good, strict=True) if view.camera == name]
        variance = variances.get(name, np.zeros(6))
        return CameraCalibration(
            X_WC=found[name],
            rms=float(np.sqrt(np.mean(np.square(own)))),
            position_error=float(np.sqrt(variance[3:].sum())),
            rotation_error=float(np.sqrt(variance[:3].sum())),
        )

    results = {camera.name: calibration(camera.name) for camera in cameras}
    return CalibrationResult(results, boards, left_out, square)


def _minimize(errors: Callable[[np.ndarray], np.ndarray], start: np.ndarray, loss: str) -> Any:
    """Minimizes the sum of squared errors, or of another loss; see `least_squares`."""
    return least_squares(errors, start, loss=loss, x_scale="jac", max_nfev=_MOST_STEPS)


def _fitting_square(problem: "_Reprojection", x: np.ndarray, square: float) -> float:
    """Returns the edge of the squares [m] with which the board fits the hand's motions best.

    Raises:
        CalibrationError: if it is far from the stated edge, and fits much better.
    """
    scaled = _minimize(lambda y: problem.errors(y[:-1], y[-1]), np.append(x, 1.0), "soft_l1").x
    scale = float(scaled[-1])
    before = np.median(problem.image_rms(x))
    after = np.median(problem.image_rms(scaled[:-1], scale=scale))
    if abs(scale - 1.0) > _LARGEST_RESCALING and after < 0.5 * before:
        raise CalibrationError(
            f"The hand's motions fit squares of {1e3 * scale * square:.1f} mm, but the board is "
            f"said to have squares of {1e3 * square:.1f} mm.",
            remedy="Measure a row of squares on the print, and give the edge with --square [m]. "
            "If it is right, check the cameras' focal lengths in the scenario.",
        )
    return scale * square


def _misfit(error: float, left_out: int, count: int, on_hand: bool) -> CalibrationError:
    check = "board and cameras were at rest in each view"
    if on_hand:
        check = (
            "the board did not slip on the hand, and that the joint positions are those at the "
            "images, with the arm at rest"
        )
    return CalibrationError(
        f"The views do not fit one board: the median reprojection error is {error:.1f} px, and "
        f"{left_out} of {count} images do not fit the others.",
        remedy=f"Check that {check}; also that the squares have the stated size, and that the "
        "images have the scenario's intrinsics, without lens distortion. Then take new views.",
    )


def _check_views(
    cameras: Sequence[CameraModel],
    views: Sequence[BoardView],
    hand_poses: np.ndarray | None,
    kept: str | None,
) -> None:
    """Checks that the views suffice."""
    seen = {camera.name: {v.view for v in views if v.camera == camera.name} for camera in cameras}
    fewest = _FEWEST_VIEWS
    if hand_poses is None:
        fewest = _FEWEST_LOOSE_VIEWS
        if kept not in seen:
            raise CalibrationError(
                f"The camera to keep, '{kept}', is not among the cameras.",
                remedy=f"Choose one of: {', '.join(seen)}.",
            )
        if len(seen) < 2:
            raise CalibrationError(
                f"The scenario has only the camera '{kept}', and a loose board gives poses "
                "between cameras.",
                remedy="Fix the board to the hand instead.",
            )
        # Only views that two cameras share tell their relative pose.
        shared = {v for v in set().union(*seen.values()) if sum(v in s for s in seen.values()) > 1}
        seen = {name: found & shared for name, found in seen.items()}
    for name, found in seen.items():
        if len(found) < fewest:
            where = " together with another camera" if hand_poses is None else ""
            raise CalibrationError(
                f"Camera '{name}' sees the board{where} in {len(found)} usable views, but at least "
                f"{fewest} are needed; 15 are better.",
                remedy="Take more views in which the board faces the camera and is not cut off, or "
                "leave the camera out with --cameras.",
            )
    if hand_poses is not None:
        used = sorted(set().union(*seen.values()))
        R = hand_poses[used][:, :3, :3]
        turns = rotation_log(R[0].T @ R)
        angles = np.linalg.svd(turns - turns.mean(axis=0), compute_uv=False) / np.sqrt(len(used))
        if angles[1] < _LEAST_TURN:
            raise CalibrationError(
                "The hand hardly turns between the views: "
                f"{np.rad2deg(angles[0]):.0f} degrees (RMS) about one axis, "
                f"{np.rad2deg(angles[1]):.0f} about a second one; at least "
                f"{np.rad2deg(_LEAST_TURN):.0f} are needed.",
                remedy="Take views with the board tilted to several sides, by 20 to 40 degrees, "
                "and turned in its plane.",
            )


class _Reprojection:
    """Reprojection errors as a function of small changes of all unknown poses.

    The unknowns are six numbers for each pose X: a turn w and a shift t, so that the pose is
    (exp(w) R, p + t) for X = (R, p). First come the cameras, then X_GB or the boards of the views.
    """

    def __init__(
        self,
        cameras: Sequence[CameraModel],
        views: Sequence[BoardView],
        board: CalibrationBoard,
        hand_poses: np.ndarray | None,
        start: Poses,
        free: Sequence[str],
    ):
        found, boards, self._X_GB = start
        self._free, self._hand_poses = list(free), hand_poses
        self._names = [camera.name for camera in cameras]
        self._numbers = sorted({view.view for view in views})
        self._cameras = np.stack([found[name] for name in self._names])
        self._boards = np.stack([boards[number] for number in self._numbers])
        K = np.stack([camera.K for camera in cameras])
        lengths = [len(view.corners) for view in views]
        self._camera = np.repeat([self._names.index(view.camera) for view in views], lengths)
        self._view = np.repeat([self._numbers.index(view.view) for view in views], lengths)
        self._image = np.repeat(np.arange(len(views)), lengths)
        self._corners = np.concatenate([board.corners[view.corners] for view in views])
        self._pixels = np.concatenate([view.pixels for view in views])
        self._K = K[self._camera]
        unknown = len(self._free) + (1 if hand_poses is not None else len(self._numbers))
        self.zero = np.zeros(6 * unknown)
        self.view_of_row = np.repeat(self._view, 2)

    def poses(self, x: np.ndarray) -> Poses:
        """Returns all poses for the changes x."""
        cameras, boards, X_GB = self._moved(x)
        return (
            dict(zip(self._names, cameras, strict=True)),
            dict(zip(self._numbers, boards, strict=True)),
            X_GB,
        )

    def errors(self, x: np.ndarray, scale: float = 1.0) -> np.ndarray:
        """Returns the reprojection errors (2M,) [px] for the changes x and a scaled board."""
        cameras, boards, _ = self._moved(x)
        X_CB = inverse(cameras)[self._camera] @ boards[self._view]
        p = transform_points(X_CB, scale * self._corners[:, None])[:, 0]
        homogeneous = np.einsum("mij,mj->mi", self._K, p)
        # A corner behind a camera gives a large error instead of a mirrored pixel.
        depth = np.maximum(homogeneous[:, 2:], 1e-3)
        return (homogeneous[:, :2] / depth - self._pixels).ravel()

    def without_outliers(self, views: Sequence[BoardView], x: np.ndarray) -> list[BoardView]:
        """Returns the problem's views without misplaced corners."""
        sizes = np.linalg.norm(self.errors(x).reshape(-1, 2), axis=1)
        kept = []
        for image, view in enumerate(views):
            own = sizes[self._image == image]
            fits = own <= _OUTLIER_FACTOR * np.median(own)
            kept.append(replace(view, corners=view.corners[fits], pixels=view.pixels[fits]))
        return kept

    def image_rms(self, x: np.ndarray, scale: float = 1.0) -> np.ndarray:
        """Returns the RMS reprojection error [px] of each image's corners."""
        squares = (self.errors(x, scale).reshape(-1, 2) ** 2).sum(axis=1)
        return np.sqrt(np.bincount(self._image, squares) / np.bincount(self._image))

    def _moved(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        steps = x.reshape(-1, 6)
        cameras = self._cameras.copy()
        which = [self._names.index(name) for name in self._free]
        cameras[which] = _stepped(cameras[which], steps[: len(which)])
        rest = steps[len(which) :]
        if self._hand_poses is None:
            return cameras, _stepped(self._boards, rest), self._X_GB
        X_GB = _stepped(self._X_GB, rest[0])
        return cameras, self._hand_poses[self._numbers] @ X_GB, X_GB


def _stepped(X: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Returns poses (..., 4, 4) after turns and shifts (..., 6) in the poses' base frame."""
    return make_transform(
        rotation_exp(steps[..., :3]) @ X[..., :3, :3], X[..., :3, 3] + steps[..., 3:]
    )


def _jackknife(jacobian: np.ndarray, errors: np.ndarray, view_of_row: np.ndarray) -> np.ndarray:
    """Returns the variances (P,) of least-squares estimates, by leaving out one view at a time.

    The estimate without a view is one Gauss-Newton step away from the estimate with all views.
    """
    views = np.unique(view_of_row)
    steps = np.stack(
        [
            np.linalg.lstsq(jacobian[view_of_row != v], errors[view_of_row != v], rcond=None)[0]
            for v in views
        ]
    )
    return (len(views) - 1) / len(views) * ((steps - steps.mean(axis=0)) ** 2).sum(axis=0)
