"""Tracks points by OpenCV's Lucas-Kanade optical flow in each view, lifted by depth; a baseline."""

from dataclasses import dataclass, field

import cv2
import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.depth_image import project
from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage
from poil_drake.perception.positive_fields import check_positive
from poil_drake.perception.trackers.rigid_points.sight import lift_pixels, visible
from poil_drake.perception.trackers.rigid_points.tracker import (
    Matches,
    RigidPointsState,
    RigidPointsTracker,
)


@dataclass(frozen=True, kw_only=True)
class LucasKanadeConfig:
    """Parameters of the Lucas-Kanade tracker.

    Attributes:
        window: Width of the compared patches [px]. Larger patches have more texture, but more often
            include the background.
        levels: Number of times that the images are halved for the search. The flow may depart from
            its prediction by about window / 2 * 2**levels pixels.
        max_return_error: Largest distance between a point and where the flow back from the new
            image ends [px]; farther points are occluded or confused.
        support_points: Number of points, spread over the object, that are tracked beside the part's
            (POIL uses 40); in a scenario, `poil.num_support_points`.
    """

    window: int = 21
    levels: int = 3
    max_return_error: float = 1.0
    support_points: int = field(default=40, metadata={"yaml": False})

    def __post_init__(self) -> None:
        check_positive(self, "max_return_error", "support_points")
        for name, least, most in (("window", 3, 201), ("levels", 0, 10)):
            if not least <= getattr(self, name) <= most:
                raise InvalidValueError(
                    f"LucasKanadeConfig.{name} is {getattr(self, name)}.",
                    remedy=f"Set a whole number from {least} to {most}.",
                )


class LucasKanadeTracker(RigidPointsTracker):
    """Follows points from the last frame in which the object was tracked; a `Tracker`.

    The flow (Bouguet 2000, pyramidal Lucas-Kanade) starts from the motion prior. It needs texture,
    and its errors accumulate, since each frame is compared with the previous one.
    """

    def __init__(self, config: LucasKanadeConfig | None = None):
        """Constructs the tracker.

        Args:
            config: Parameters; None for the defaults.
        """
        self.config = config or LucasKanadeConfig()
        super().__init__(support_points=self.config.support_points, memory=1)

    def _match(
        self, state: RigidPointsState, frame: MultiViewFrame, predicted: np.ndarray
    ) -> Matches:
        old, motion = state.recent[-1] if state.recent else state.start
        before = transform_points(motion, state.points)
        guess = transform_points(predicted, state.points)
        views = zip(frame.cameras, old.images, frame.images, strict=True)
        return Matches.joined([self._match_view(*view, before, guess) for view in views])

    def _match_view(
        self,
        camera: CameraModel,
        old: RgbdImage,
        new: RgbdImage,
        before: np.ndarray,
        guess: np.ndarray,
    ) -> Matches:
        """Returns where a view shows points that were at `before`, and may now be at `guess`."""
        ids = np.flatnonzero(visible(before, camera, old))
        if ids.size == 0:
            return Matches(ids, np.empty((0, 3)), np.empty(0))
        uv, near = (
            project(points[ids], camera.K, camera.X_WC)[0].astype(np.float32)
            for points in (before, guess)
        )
        near = np.where(np.isfinite(near), near, uv)
        grey = [cv2.cvtColor(image.rgb, cv2.COLOR_RGB2GRAY) for image in (old, new)]
        options = {
            "winSize": (self.config.window, self.config.window),
            "maxLevel": self.config.levels,
            "flags": cv2.OPTFLOW_USE_INITIAL_FLOW,
        }
        there, found, _ = cv2.calcOpticalFlowPyrLK(*grey, uv, near, **options)
        back, returned, _ = cv2.calcOpticalFlowPyrLK(*grey[::-1], there, uv.copy(), **options)
        error = np.linalg.norm(back - uv, axis=1)
        followed = (found & returned).ravel().astype(bool) & (error < self.config.max_return_error)
        positions = lift_pixels(there[followed].astype(float), camera, new)
        return Matches(ids[followed], positions, np.ones(len(positions)))
