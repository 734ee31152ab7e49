"""CoTracker3: a network that tracks pixels in a video; here in each view, lifted by depth.

Karaev et al., "CoTracker3: Simpler and Better Point Tracking by Pseudo-Labelling Real Videos",
2024.
"""

import numpy as np

from poil_drake.geometry.depth_image import project
from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.trackers.learned.clip_tracker import Clip, ClipTracker
from poil_drake.perception.trackers.learned.config import CoTracker3Config
from poil_drake.perception.trackers.rigid_points.sight import lift_pixels, visible
from poil_drake.perception.trackers.rigid_points.tracker import Matches, RigidPointsState

_WINDOW = 16  # frames of one window of the online model


class CoTracker3(ClipTracker):
    """Tracks points by the online model of CoTracker3; a `Tracker`. See `ClipTracker`.

    The model's own stream advances by half a window, 8 frames or 1 s, which is too late for
    control. So each frame is the last of a new window, which begins with the first frame. Each view
    is tracked alone; their tracks meet in the fit of the object's motion.
    """

    def __init__(self, config: CoTracker3Config | None = None):
        """Checks the environment; the model is loaded at the first start.

        Args:
            config: Where the model runs; None for the defaults.

        Raises:
            MissingDependencyError: if the environment, the repository or the weights are missing.
        """
        self.config = config or CoTracker3Config()
        super().__init__(self.config, model="cotracker3", min_frames=_WINDOW, window=_WINDOW)

    def _encode(self, frame: MultiViewFrame) -> dict[str, np.ndarray]:
        return {f"rgb_{view}": image.rgb for view, image in enumerate(frame.images)}

    def _observe(self, state: RigidPointsState, clip: Clip, timeout: float) -> Matches:
        new = clip.frames[clip.newest]
        request: dict[str, np.ndarray] = {}
        ids = {}
        for view in range(len(new.cameras)):
            ids[view], queries = _queries(state.points, clip, view)
            if ids[view].size:
                request[f"queries_{view}"] = queries
        if not request:
            return Matches.joined([])
        answer = self._ask(clip, request, timeout)
        matches = []
        for view, (camera, image) in enumerate(zip(new.cameras, new.images, strict=True)):
            if ids[view].size:
                shown = answer[f"visible_{view}"][clip.newest]
                uv = answer[f"tracks_{view}"][clip.newest][shown].astype(float)
                positions = lift_pixels(uv, camera, image)
                matches.append(Matches(ids[view][shown], positions, np.ones(len(uv))))
        return Matches.joined(matches)


def _queries(points: np.ndarray, clip: Clip, view: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns which points (Q,) are queried in a view, and the queries (Q, 3): frame, u, v.

    Args:
        points: (M, 3) the points at the start [m, world].
        clip: The clip.
        view: Index of the view.
    """
    ids, queries = [], []
    for time, (frame, motion) in clip.queries:
        camera, now = frame.cameras[view], transform_points(motion, points)
        shown = np.flatnonzero(visible(now, camera, frame.images[view]))
        uv, _ = project(now[shown], camera.K, camera.X_WC)
        ids.append(shown)
        queries.append(np.column_stack([np.full(len(shown), time), uv]))
    return np.concatenate(ids), np.concatenate(queries)
