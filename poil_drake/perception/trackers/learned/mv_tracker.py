"""MVTracker: a network that tracks points in the fused cloud of several RGB-D views.

Rajič et al., "Multi-View 3D Point Tracking", ICCV 2025.
"""

from collections.abc import Sequence

import cv2
import numpy as np

from poil_drake.geometry.rigid_transform import inverse, transform_points
from poil_drake.perception.images import CameraModel, MultiViewFrame
from poil_drake.perception.trackers.learned.clip_tracker import Clip, ClipTracker
from poil_drake.perception.trackers.learned.config import MvTrackerConfig
from poil_drake.perception.trackers.rigid_points.sight import visible
from poil_drake.perception.trackers.rigid_points.tracker import Matches, RigidPointsState

_WINDOW = 12  # frames that the model sees at once
_MIN_FRAMES = 7  # of a shorter clip, the model returns zeros
_SIZE = (512, 384)  # width and height to which the model scales all images [px]
_MIN_PROBABILITY = 0.5  # of being visible, below which a track is not used


class MvTracker(ClipTracker):
    """Tracks points by MVTracker; a `Tracker`. See `ClipTracker`.

    Queries are points that at least one view shows in the queried frame, since a hidden one would
    get the features of what hides it.
    """

    def __init__(self, config: MvTrackerConfig | None = None):
        """Checks the environment; the model is loaded at the first start.

        Args:
            config: Where the model runs, and its parameters; None for the defaults.

        Raises:
            MissingDependencyError: if the environment, the repository or the weights are missing.
        """
        self.config = config or MvTrackerConfig()
        super().__init__(self.config, model="mvtracker", min_frames=_MIN_FRAMES, window=_WINDOW)

    def _observe(self, state: RigidPointsState, clip: Clip, timeout: float) -> Matches:
        scale = self.config.scene_scale
        origin = np.array([*state.points[:, :2].mean(axis=0), self.config.table_height])
        ids, queries = _queries(state.points, clip)
        if ids.size == 0:
            return Matches.joined([])
        queries[:, 1:] = scale * (queries[:, 1:] - origin)
        cameras = clip.frames[0].cameras
        answer = self._ask(
            clip,
            {
                "K": np.array([_scaled_intrinsics(camera) for camera in cameras]),
                "X_CW": np.array([_scaled_extrinsics(c.X_WC, scale, origin) for c in cameras]),
                "queries": queries,
            },
            timeout,
        )
        probability = answer["visibility"][clip.newest].astype(float)
        shown = probability > _MIN_PROBABILITY  # False for NaN, too.
        tracks = answer["tracks"][clip.newest].astype(float) / scale + origin
        return Matches.joined([Matches(ids[shown], tracks[shown], probability[shown])])

    def _encode(self, frame: MultiViewFrame) -> dict[str, np.ndarray]:
        rgb = _in_model_size([image.rgb for image in frame.images])
        depth = _in_model_size([image.depth for image in frame.images])
        # NaN would reach all points of the cloud.
        near = (depth > 0.0) & (depth <= self.config.max_depth)
        scaled = np.where(near, np.float32(self.config.scene_scale) * depth, np.float32(0.0))
        return {"rgb": rgb, "depth": scaled}


def _queries(points: np.ndarray, clip: Clip) -> tuple[np.ndarray, np.ndarray]:
    """Returns which points (Q,) are queried, and the queries (Q, 4): frame in the clip, position.

    Args:
        points: (M, 3) the points at the start [m, world].
        clip: The clip.
    """
    ids, queries = [np.empty(0, dtype=int)], [np.empty((0, 4))]
    for time, (frame, motion) in clip.queries:
        now = transform_points(motion, points)
        views = zip(frame.cameras, frame.images, strict=True)
        shown = np.flatnonzero(np.any([visible(now, *view) for view in views], axis=0))
        ids.append(shown)
        queries.append(np.column_stack([np.full(len(shown), time), now[shown]]))
    return np.concatenate(ids), np.concatenate(queries)


def _in_model_size(images: Sequence[np.ndarray]) -> np.ndarray:
    """Returns the images of V views in the model's size, (V, 384, 512, ...).

    Neighbours are chosen, not averaged, as the model does: averaged depth would lie between
    surfaces. This also gives views of different sizes one size.
    """
    return np.array([cv2.resize(i, _SIZE, interpolation=cv2.INTER_NEAREST) for i in images])


def _scaled_intrinsics(camera: CameraModel) -> np.ndarray:
    return np.diag([_SIZE[0] / camera.width, _SIZE[1] / camera.height, 1.0]) @ camera.K


def _scaled_extrinsics(X_WC: np.ndarray, scale: float, origin: np.ndarray) -> np.ndarray:
    """Returns [R t] (3, 4) from the model's world, p' = scale (p - origin), to scale x camera."""
    X_CW = inverse(X_WC)
    return np.column_stack([X_CW[:3, :3], scale * transform_points(X_CW, origin)])
