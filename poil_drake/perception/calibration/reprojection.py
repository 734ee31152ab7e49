"""The reprojection errors of a calibration board, and their minimization."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from poil_drake.geometry.rigid_transform import (
    inverse,
    make_transform,
    rotation_exp,
    transform_points,
)
from poil_drake.perception.calibration.board import CalibrationBoard
from poil_drake.perception.calibration.first_guess import BoardView, Poses
from poil_drake.perception.images import CameraModel

_MOST_STEPS = 50  # of a minimization; good views need 5 to 15, others end as a misfit


class Reprojection:
    """Reprojection errors as a function of small changes of all unknown poses.

    The unknowns are six numbers for each pose X: a turn w and a shift t, so that the pose is
    (exp(w) R, p + t) for X = (R, p). First come the cameras, then X_GB or the boards of the views.
    Corrections may follow: the first coefficient k1 of the radial distortion of each camera, and
    factors of the `lengths`.

    Attributes:
        names: The cameras.
        free: Indices of the cameras whose poses are unknown.
        lengths: Focal length of each camera [px]; for a board on the hand, also the squares' edge
            [m].
        start: The unknowns before the minimization.
        start_corrected: The same, with corrections.
        view_of_row: (2M,) index of the view to which an error belongs.
    """

    def __init__(
        self,
        cameras: Sequence[CameraModel],
        views: Sequence[BoardView],
        board: CalibrationBoard,
        hand_poses: np.ndarray | None,
        start: Poses,
        known: Collection[str],
    ):
        """Constructs the problem from all poses at the start; those of known cameras are kept."""
        found, boards, self._X_GB = start
        self._hand_poses = hand_poses
        self.names = [camera.name for camera in cameras]
        self.free = [k for k, name in enumerate(self.names) if name not in known]
        self._numbers = sorted(boards)
        self._cameras = np.stack([found[name] for name in self.names])
        self._boards = np.stack([boards[number] for number in self._numbers])
        lengths = [len(view.corners) for view in views]
        self._camera = np.repeat([self.names.index(view.camera) for view in views], lengths)
        self._view = np.repeat([self._numbers.index(view.view) for view in views], lengths)
        self._image = np.repeat(np.arange(len(views)), lengths)
        self._corners = np.concatenate([board.corners[view.corners] for view in views])
        self._pixels = np.concatenate([view.pixels for view in views])
        self._K = np.stack([camera.K for camera in cameras])[self._camera]
        self.view_of_row = np.repeat(self._view, 2)
        self.lengths = [float(camera.K[0, 0]) for camera in cameras]
        if hand_poses is not None:
            self.lengths.append(board.square)
        unknown = len(self.free) + (1 if hand_poses is not None else len(self._numbers))
        self.start = np.zeros(6 * unknown)
        self.start_corrected = np.concatenate(
            [self.start, np.zeros(len(cameras)), np.ones(len(self.lengths))]
        )

    def poses(self, x: np.ndarray) -> Poses:
        """Returns all poses for the changes x."""
        cameras, boards, X_GB = self._moved(x)
        return (
            dict(zip(self.names, cameras, strict=True)),
            dict(zip(self._numbers, boards, strict=True)),
            X_GB,
        )

    def errors(self, x: np.ndarray) -> np.ndarray:
        """Returns the reprojection errors (2M,) [px] for the changes x."""
        cameras, boards, _ = self._moved(x)
        distortion, scales = np.zeros(len(self.names)), np.ones(len(self.names) + 1)
        if len(x) > len(self.start):
            distortion, given = np.split(x[len(self.start) :], [len(self.names)])
            scales[: len(given)] = given
        X_CB = inverse(cameras)[self._camera] @ boards[self._view]
        p = transform_points(X_CB, scales[-1] * self._corners[:, None])[:, 0]
        # A corner behind a camera gives a large error instead of a mirrored pixel.
        p /= np.maximum(p[:, 2:], 1e-3)
        squared_radius = np.sum(p[:, :2] ** 2, axis=1)
        k1, scale = distortion[self._camera], scales[self._camera]
        p[:, :2] *= (scale * (1.0 + k1 * squared_radius))[:, None]
        return (np.einsum("mij,mj->mi", self._K[:, :2], p) - self._pixels).ravel()

    def without_outliers(
        self, views: Sequence[BoardView], x: np.ndarray, factor: float
    ) -> list[BoardView]:
        """Returns the views without corners whose error is `factor` times their view's median."""
        sizes = np.linalg.norm(self.errors(x).reshape(-1, 2), axis=1)
        kept = []
        for image, view in enumerate(views):
            own = sizes[self._image == image]
            fits = own <= factor * np.median(own)
            kept.append(replace(view, corners=view.corners[fits], pixels=view.pixels[fits]))
        return kept

    def image_rms(self, x: np.ndarray) -> np.ndarray:
        """Returns the RMS reprojection error [px] of each image's corners."""
        squares = (self.errors(x).reshape(-1, 2) ** 2).sum(axis=1)
        return np.sqrt(np.bincount(self._image, squares) / np.bincount(self._image))

    def _moved(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        steps = x[: len(self.start)].reshape(-1, 6)
        cameras = self._cameras.copy()
        cameras[self.free] = _stepped(cameras[self.free], steps[: len(self.free)])
        rest = steps[len(self.free) :]
        if self._hand_poses is None:
            return cameras, _stepped(self._boards, rest), self._X_GB
        X_GB = _stepped(self._X_GB, rest[0])
        return cameras, self._hand_poses[self._numbers] @ X_GB, X_GB


def _stepped(X: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Returns poses (..., 4, 4) after turns and shifts (..., 6) in the poses' base frame."""
    return make_transform(
        rotation_exp(steps[..., :3]) @ X[..., :3, :3], X[..., :3, 3] + steps[..., 3:]
    )


def minimize(problem: Reprojection, start: np.ndarray, loss: str = "linear") -> Any:
    """Minimizes the squared errors, or another loss of them; see SciPy's `least_squares`."""
    return least_squares(problem.errors, start, loss=loss, x_scale="jac", max_nfev=_MOST_STEPS)


def jackknife(solution: Any, view_of_row: np.ndarray) -> np.ndarray:
    """Returns the variances (P,) of least-squares estimates, by leaving out one view at a time.

    The estimate without a view is one Gauss-Newton step away from the estimate with all views.
    """
    jacobian, errors = solution.jac, solution.fun
    views = np.unique(view_of_row)
    steps = np.stack(
        [
            np.linalg.lstsq(jacobian[view_of_row != v], errors[view_of_row != v], rcond=None)[0]
            for v in views
        ]
    )
    return (len(views) - 1) / len(views) * ((steps - steps.mean(axis=0)) ** 2).sum(axis=0)
