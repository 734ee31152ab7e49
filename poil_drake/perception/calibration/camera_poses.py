"""Estimates the poses of fixed cameras from views of one calibration board.

Each view v has one pose of the board. Camera c observes the board's corners p at the pixels

    u_cvk = project(K_c, X_WCc^-1 X_WBv p_k).

If the board is on the robot's hand, X_WBv = X_WGv X_GB, where the gripper's poses X_WGv are known
and X_GB is not ("eye to hand"). If the board is loose, every X_WBv is unknown, and the pose of one
camera is kept. All unknown poses minimize the squared reprojection errors of all cameras together.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student_t

from poil_drake.errors import CalibrationError
from poil_drake.geometry.rigid_transform import rotation_log
from poil_drake.perception.calibration.board import CalibrationBoard
from poil_drake.perception.calibration.first_guess import BoardView, first_guess
from poil_drake.perception.calibration.reprojection import Reprojection, jackknife, minimize
from poil_drake.perception.images import CameraModel

_FEWEST_VIEWS = 6  # of a board on the hand, for each camera; fewer leave no redundancy
_FEWEST_LOOSE_VIEWS = 3  # of a loose board, for each camera together with another one

_LEAST_TURN = np.deg2rad(10.0)
"""RMS angle by which the hand must turn about a second axis. A hand that turns about one axis only
leaves the board's place along that axis unknown."""

_OUTLIER_FACTOR, _LEAST_OUTLIER = 4.0, 1.0
"""An image is left out if its RMS error exceeds this multiple of the median and this error [px];
one corner, if its error exceeds this multiple of its image's median."""

_LARGEST_LEFT_OUT = 0.25  # of the images
_LARGEST_RMS = 3.0  # reprojection error of half of the images [px]; good cameras reach 0.1 to 1

_WRONG_LENGTH, _DISTORTED, _CHANCE = 0.01, 0.05, 1e-4
"""A stated length is wrong if the one that fits the views differs by this fraction, and an image is
distorted if |k1| exceeds this, unless by chance with this probability. Such a focal length moves a
camera by 7 mm at 0.7 m, such a distortion by 1 mm, yet both reproject well."""


@dataclass(frozen=True)
class FittingLength:
    """A length as stated and as it fits the views best, with its standard error."""

    stated: float
    found: float
    error: float


@dataclass(frozen=True, eq=False)
class CameraCalibration:
    """The result for one camera.

    Attributes:
        X_WC: (4, 4) pose of the optical frame in the world [m].
        rms: RMS reprojection error [px].
        position_error: Estimated standard error of the position [m], root of the summed variances;
            0 if the pose was kept.
        rotation_error: Estimated standard error of the rotation [rad]; likewise.
        focal_length: The focal length [px]. X_WC is for the stated one.
    """

    X_WC: np.ndarray
    rms: float
    position_error: float
    rotation_error: float
    focal_length: FittingLength

    @property
    def error_text(self) -> str:
        """How well the pose is known, in words."""
        if self.position_error == 0.0:
            return "pose kept"
        return (
            f"standard error {1e3 * self.position_error:.2f} mm, "
            f"{np.rad2deg(self.rotation_error):.3f} deg"
        )


@dataclass(frozen=True, eq=False)
class CalibrationResult:
    """The result for all cameras.

    Attributes:
        cameras: Name -> result.
        boards: View -> (4, 4) pose X_WB of the board [m].
        left_out: Images that do not fit the others.
        square: The edge of the squares [m]; None for a loose board.
    """

    cameras: Mapping[str, CameraCalibration]
    boards: Mapping[int, np.ndarray]
    left_out: tuple[BoardView, ...]
    square: FittingLength | None = None


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
        CalibrationError: if there are too few views, if the hand turns too little, if the views do
            not fit one board, or if they show that the squares' edge or a focal length is wrong, or
            that a lens distorts.
    """
    _check_views(cameras, views, hand_poses)
    known = {camera.name: camera.X_WC for camera in cameras if camera.name == kept}
    start = first_guess(cameras, views, board, hand_poses, known)
    problem = Reprojection(cameras, views, board, hand_poses, start, known)
    # An image that does not fit, e.g. one of a moving arm, must not spoil the others.
    x = minimize(problem, problem.start_corrected, "soft_l1").x
    errors = problem.image_rms(x)
    median = float(np.median(errors))
    fits = errors <= max(_OUTLIER_FACTOR * median, _LEAST_OUTLIER)
    left_out = tuple(view for view, ok in zip(views, fits, strict=True) if not ok)
    if median > _LARGEST_RMS or len(left_out) > _LARGEST_LEFT_OUT * len(views):
        raise _misfit(median, len(left_out), len(views), hand_poses is not None)
    clean = problem.without_outliers(views, x, _OUTLIER_FACTOR)
    good = [view for view, ok in zip(clean, fits, strict=True) if ok]
    _check_views(cameras, good, hand_poses)

    problem = Reprojection(cameras, good, board, hand_poses, problem.poses(x), known)
    focal_lengths, square = _fitting_lengths(problem)
    solution = minimize(problem, problem.start)
    variances, free = np.zeros((len(cameras), 6)), problem.free
    spread = jackknife(solution, problem.view_of_row)
    variances[free] = spread[: 6 * len(free)].reshape(-1, 6)
    found, boards, _ = problem.poses(solution.x)
    rms = problem.image_rms(solution.x)

    results = {}
    for name, variance in zip(problem.names, variances, strict=True):
        own = [error for error, view in zip(rms, good, strict=True) if view.camera == name]
        results[name] = CameraCalibration(
            X_WC=found[name],
            rms=float(np.sqrt(np.mean(np.square(own)))),
            position_error=float(np.sqrt(variance[3:].sum())),
            rotation_error=float(np.sqrt(variance[:3].sum())),
            focal_length=focal_lengths[name],
        )
    return CalibrationResult(results, boards, left_out, square)


def _fitting_lengths(
    problem: Reprojection,
) -> tuple[dict[str, FittingLength], FittingLength | None]:
    """Returns each camera's focal length [px], and the squares' edge [m] for a board on the hand.

    Raises:
        CalibrationError: if a stated length is wrong, or a lens distorts.
    """
    solution = minimize(problem, problem.start_corrected)
    first, count = len(problem.start), len(problem.names)
    distortion, scales = np.split(solution.x[first:], [count])
    all_errors = np.sqrt(jackknife(solution, problem.view_of_row)[first:])
    limits = student_t.isf(_CHANCE, len(np.unique(problem.view_of_row)) - 1) * all_errors
    errors = all_errors[count:]
    wrong = np.abs(scales - 1.0) > np.maximum(limits[count:], _WRONG_LENGTH)
    for name, k1, limit in zip(problem.names, distortion, limits, strict=False):
        if abs(k1) > max(limit, _DISTORTED):
            raise CalibrationError(
                f"The images of camera '{name}' have a lens distortion of k1 = {k1:.2f}.",
                remedy="Rectify them where they are captured, and state their focal length then.",
            )
    lengths = [
        FittingLength(stated, float(stated * scale), float(stated * error))
        for stated, scale, error in zip(problem.lengths, scales, errors, strict=True)
    ]
    focal_lengths = dict(zip(problem.names, lengths, strict=False))
    square = lengths[-1] if len(lengths) > len(focal_lengths) else None
    if square is not None and wrong[-1]:
        raise CalibrationError(
            f"The hand's motions fit squares of {1e3 * square.found:.1f} mm, but the board is said "
            f"to have squares of {1e3 * square.stated:.1f} mm.",
            remedy="Measure a row of squares on the print, and give the edge with --square [m].",
        )
    for (name, length), is_wrong in zip(focal_lengths.items(), wrong, strict=False):
        if is_wrong:
            raise CalibrationError(
                f"The views fit a focal length of {length.found:.1f} px for camera '{name}', but "
                f"the scenario has {length.stated:.1f} px.",
                remedy=f"Set cameras.{name}.focal to that of the images, which must be without "
                "lens distortion.",
            )
    return focal_lengths, square


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
    cameras: Sequence[CameraModel], views: Sequence[BoardView], hand_poses: np.ndarray | None
) -> None:
    """Checks that the views suffice."""
    seen = {camera.name: {v.view for v in views if v.camera == camera.name} for camera in cameras}
    fewest = _FEWEST_VIEWS
    if hand_poses is None:
        fewest = _FEWEST_LOOSE_VIEWS
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
