"""Judges by the first frame whether the units of depth and the poses of cameras can be right."""

from collections.abc import Sequence

import numpy as np

from poil_drake.errors import CaptureError
from poil_drake.geometry.depth_image import unproject
from poil_drake.geometry.rigid_transform import inverse, transform_points
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage

_MIN_POINTS = 100  # Fewer points do not tell.
_MAX_POINTS = 20_000  # about; more would only take longer
_CLEARLY_SEEN = 0.2  # share of a camera's points that lie on the table
_SEEN = 0.1  # share with which the unit of depth must be right
_CLEARLY_MORE = 4.0  # ratio of this share to that with the camera's own unit and pose
_LEAST_SEEN = 0.01  # share of the camera that sees most of the table
_TOLERANCE = 0.03  # [m], for the error of a camera's pose ...
_DEPTH_TOLERANCE = 0.02  # ... and as a share of the depth, for the error of depth
# Without a known table: what a depth camera can see, and how deep a floor can be below the robot.
_LARGEST_DEPTH = 20.0  # [m]
_LOWEST_FLOOR, _HIGHEST_TABLE = -2.0, 2.0  # [m]

# Ratio of wrong to right depth, and its cause.
_UNITS = (
    (1000.0, "depth is in millimetres, but is read as metres"),
    (10.0, "a step of depth is 0.1 mm, but is read as 1 mm"),
    (4.0, "a step of depth is 0.25 mm, but is read as 1 mm"),
    (0.1, "a step of depth is 1 cm, but is read as 1 mm"),
    (0.001, "depth is in metres, but is read as millimetres"),
)
_UNIT_REMEDY = (
    "In a recording, write depth in whole millimetres (16UC1) or in metres (32FC1). For "
    "!OpenCvStreams, set its depth_scale in poil.hardware.cameras to one step [m]."
)
_POSE_REMEDY = (
    "Give the pose [m] of the optical frame (z into the image, x right, y down) in the world, e.g. "
    "of camera_color_optical_frame: in a recording by the frame_id of its calibration, in a "
    "scenario by the camera's X_PB."
)


def check_plausible(frame: MultiViewFrame, *, table_height: float | None = None) -> None:
    """Checks that depth units and camera poses can be right.

    A camera is wrong if far more of its points would lie on the table with another unit of depth or
    another convention of the pose, and all are wrong if none sees the table or anything else.
    Without a known table, any horizontal plane below a camera counts for its pose, and its unit is
    wrong if it measures more than 20 m or 2 m below the world's origin.

    Args:
        frame: The first frame.
        table_height: Height of the table [m, world]; None if it is not known.

    Raises:
        CaptureError: naming the camera and the likely cause.
    """
    views = [
        (camera, points)
        for camera, image in zip(frame.cameras, frame.images, strict=True)
        if len(points := _sampled_points(camera, image)) >= _MIN_POINTS
    ]
    for camera, points in views:
        if table_height is None:
            _check_range(camera, points)
        _check_table(camera, points, table_height)
    if table_height is not None:
        _check_all(views, table_height)


def _sampled_points(camera: CameraModel, image: RgbdImage) -> np.ndarray:
    """Returns about `_MAX_POINTS` points (N, 3) [m, optical frame]."""
    step = int(np.ceil(np.sqrt(image.depth.size / _MAX_POINTS)))
    mask = np.zeros(image.depth.shape, dtype=bool)
    mask[::step, ::step] = True
    return unproject(image.depth, camera.K, mask)[0]


def _check_range(camera: CameraModel, points: np.ndarray) -> None:
    """Checks a camera's points (N, 3) [m, optical frame] by what a depth camera can see."""
    depth, height = np.median(points[:, 2]), np.median(_heights(points, camera.X_WC))
    if depth > _LARGEST_DEPTH or height < _LOWEST_FLOOR:
        fine = "a step of depth is 0.1 mm or 0.25 mm, but is read as 1 mm"
        cause = _UNITS[0][1] if depth > 10.0 * _LARGEST_DEPTH else fine
        raise CaptureError(
            f"Camera '{camera.name}' measures a median depth of {depth:.3g} m, so that its points "
            f"have a median height of {height:.3g} m in the world. Probably {cause}.",
            remedy=_UNIT_REMEDY,
        )


def _check_table(camera: CameraModel, points: np.ndarray, table: float | None) -> None:
    """Checks a camera's points (N, 3) [m, optical frame] by the table's height [m, world]."""
    found = [
        (_share_on_table(points, X, table), cause, _POSE_REMEDY)
        for X, cause in _other_poses(camera)
    ]
    own = _share_on_table(points, camera.X_WC, table)
    # Any plane looks horizontal if it is shrunk enough, and so does a floor below a seen table.
    if table is not None and own < _SEEN:
        found += [
            (_share_on_table(points / ratio, camera.X_WC, table), cause, _UNIT_REMEDY)
            for ratio, cause in _UNITS
        ]
    share, cause, remedy = max(found)
    if share >= max(_CLEARLY_SEEN, _CLEARLY_MORE * own):
        plane = "a horizontal plane below it" if table is None else f"the table at {table:g} m"
        raise CaptureError(
            f"Camera '{camera.name}' has {own:.0%} of its points on {plane}; their median depth is "
            f"{np.median(points[:, 2]):.3g} m, and their median height is "
            f"{np.median(_heights(points, camera.X_WC)):.3g} m. {share:.0%} would lie on {plane} "
            f"if {cause}.",
            remedy=remedy,
        )


def _check_all(views: Sequence[tuple[CameraModel, np.ndarray]], table: float) -> None:
    """Checks that a camera has points (N, 3) [m, optical frame] on the table [m, world]."""
    if not views:
        raise CaptureError(
            "No camera measures depth.",
            remedy="Check that the cameras look at the table from where they can measure it: their "
            "X_PB is the pose of the optical frame, whose z axis points into the image.",
        )
    if all(_share_on_table(points, c.X_WC, table) < _LEAST_SEEN for c, points in views):
        heights = np.concatenate([_heights(points, camera.X_WC) for camera, points in views])
        share, height = _flattest(heights, below=_HIGHEST_TABLE)
        raise CaptureError(
            f"No camera sees the table at {table:g} m. {share:.0%} of all points are about "
            f"{height:.2f} m high.",
            remedy="Set poil.table_height to the height of the surface on which the objects stand, "
            "or correct the poses of the cameras, or their calibrations if these are of images of "
            "another size.",
        )


def _other_poses(camera: CameraModel) -> list[tuple[np.ndarray, str]]:
    """Returns the pose X_WC of the optical frame for each mistake in giving it, and the mistake."""
    x_forward, y_up, X_WC = np.eye(4), np.diag([1.0, -1.0, -1.0, 1.0]), camera.X_WC
    x_forward[:3, :3] = [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
    poses = [
        (X_WC @ x_forward, "its pose is that of a link (x forward, z up), not the optical frame"),
        (X_WC @ y_up, "its pose follows OpenGL (z backward, y up), not the optical frame"),
        (inverse(X_WC), "its pose is that of the world in the camera, not the reverse"),
    ]
    if np.max(np.abs(X_WC[:3, 3])) > _LARGEST_DEPTH:
        millimetres = X_WC.copy()
        millimetres[:3, 3] /= 1000.0
        poses.append((millimetres, "the position of its pose is in millimetres, not in metres"))
    return poses


def _heights(points: np.ndarray, X_WC: np.ndarray) -> np.ndarray:
    return transform_points(X_WC, points)[:, 2]


def _share_on_table(points: np.ndarray, X_WC: np.ndarray, table: float | None) -> float:
    """Returns the share of points (N, 3) [m, optical frame] on the table [m, world].

    If the table is not known, it is the horizontal plane below the camera that has most points.
    """
    heights = _heights(points, X_WC)
    if table is None:
        return _flattest(heights, below=X_WC[2, 3])[0]
    return float(np.mean(np.abs(heights - table) <= _TOLERANCE + _DEPTH_TOLERANCE * points[:, 2]))


def _flattest(heights: np.ndarray, *, below: float) -> tuple[float, float]:
    """Returns the largest share of heights (N,) [m] near one height, and this height [m]."""
    edges = np.arange(_LOWEST_FLOOR, max(below, 0.0) + 2 * _TOLERANCE, _TOLERANCE)
    counts = np.histogram(heights[heights < below], bins=edges)[0]
    pairs = counts[:-1] + counts[1:]
    return float(pairs.max()) / len(heights), float(edges[np.argmax(pairs) + 1])
