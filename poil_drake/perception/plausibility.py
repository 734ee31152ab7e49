"""Judges by the first frame whether the units of depth and the poses of cameras can be right."""

import numpy as np

from poil_drake.errors import CaptureError
from poil_drake.geometry.depth_image import unproject
from poil_drake.geometry.rigid_transform import inverse, transform_points
from poil_drake.perception.images import CameraModel, MultiViewFrame

_MIN_POINTS = 100  # Fewer points do not tell.
_MAX_POINTS = 20_000  # about; more would only take longer
_CLEARLY_SEEN = 0.2  # share of a camera's points that lie on the table
_CLEARLY_MORE = 4.0  # ratio of this share to that with the camera's own unit and pose
_LEAST_SEEN = 0.01  # share of the camera that sees most of the table
_TABLE_TOLERANCE = 0.03  # [m], for the error of a camera's pose ...
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
    "Give the pose of the optical frame (z into the image, x right, y down) in the world, e.g. of "
    "camera_color_optical_frame: in a recording by the frame_id of its calibration, in a scenario "
    "by the camera's X_PB."
)


def check_plausible(frame: MultiViewFrame, *, table_height: float | None = None) -> None:
    """Checks that depth units and camera poses can be right.

    With a known table, a camera is wrong if far more of its points would lie on the table with
    another unit of depth or another convention of the pose; all cameras together are wrong if none
    sees the table or anything else. Without it, a camera is wrong if it measures more than 20 m, if
    its points lie 2 m below the world's origin, or if it looks up and would see a horizontal plane
    below it with another convention.

    Args:
        frame: The first frame.
        table_height: Height of the table [m, world]; None if it is not known.

    Raises:
        CaptureError: naming the camera and the likely cause.
    """
    seen: list[float] = []
    heights: list[np.ndarray] = []
    for camera, image in zip(frame.cameras, frame.images, strict=True):
        step = int(np.ceil(np.sqrt(image.depth.size / _MAX_POINTS)))
        mask = np.zeros(image.depth.shape, dtype=bool)
        mask[::step, ::step] = True
        points, _ = unproject(image.depth, camera.K, mask)
        if len(points) < _MIN_POINTS:
            continue
        if table_height is None:
            _check_without_table(camera, points)
        else:
            seen.append(_check_with_table(camera, points, table_height))
            heights.append(transform_points(camera.X_WC, points)[:, 2])
    if table_height is not None and not seen:
        raise CaptureError(
            "No camera measures depth.",
            remedy="Check that the cameras look at the table from where they can measure it: their "
            "X_PB is the pose of the optical frame, whose z axis points into the image.",
        )
    if seen and max(seen) < _LEAST_SEEN:
        share, height = _flattest(np.concatenate(heights), below=_HIGHEST_TABLE)
        raise CaptureError(
            f"No camera sees the table at {table_height:g} m. {share:.0%} of all points are about "
            f"{height:.2f} m high.",
            remedy="Set poil.table_height to the height of the surface on which the objects stand, "
            "or correct the poses of the cameras.",
        )


def _check_with_table(camera: CameraModel, points: np.ndarray, table: float) -> float:
    """Checks a camera by its points (N, 3) [m, optical frame] and the table's height [m, world].

    Returns:
        The share of the points that lie on the table.
    """

    def seen(points: np.ndarray, X_WC: np.ndarray) -> float:
        tolerance = _TABLE_TOLERANCE + _DEPTH_TOLERANCE * points[:, 2]
        on_table = np.abs(transform_points(X_WC, points)[:, 2] - table) <= tolerance
        return float(np.mean(on_table))

    own = seen(points, camera.X_WC)
    found = [(seen(points / ratio, camera.X_WC), cause, _UNIT_REMEDY) for ratio, cause in _UNITS]
    found += [(seen(points, X), cause, _POSE_REMEDY) for X, cause in _other_poses(camera)]
    share, cause, remedy = max(found)
    if share < max(_CLEARLY_SEEN, _CLEARLY_MORE * own):
        return own
    raise CaptureError(
        f"Camera '{camera.name}' has {own:.0%} of its points on the table at {table:g} m; its "
        f"median depth is {np.median(points[:, 2]):.3g} m, and their median height is "
        f"{_median_height(points, camera.X_WC):.3g} m. {share:.0%} would lie on the table if "
        f"{cause}.",
        remedy=remedy,
    )


def _check_without_table(camera: CameraModel, points: np.ndarray) -> None:
    """Checks a camera by its points (N, 3) [m, optical frame] alone."""
    depth, height = float(np.median(points[:, 2])), _median_height(points, camera.X_WC)
    if depth > _LARGEST_DEPTH or height < _LOWEST_FLOOR:
        _, cause = _UNITS[0] if depth > 10 * _LARGEST_DEPTH else _UNITS[1]
        raise CaptureError(
            f"Camera '{camera.name}' measures a median depth of {depth:.3g} m, so that its points "
            f"have a median height of {height:.3g} m in the world. Probably {cause}.",
            remedy=_UNIT_REMEDY,
        )
    if height < camera.X_WC[2, 3] or camera.X_WC[2, 2] < 0.0:
        return
    found = [
        (_flattest(transform_points(X, points)[:, 2], below=X[2, 3])[0], cause)
        for X, cause in _other_poses(camera)
    ]
    share, cause = max(found)
    if share >= _CLEARLY_SEEN:
        raise CaptureError(
            f"Camera '{camera.name}' looks up, at points {height - camera.X_WC[2, 3]:.2f} m above "
            f"it. {share:.0%} of them would lie on a horizontal plane below it if {cause}.",
            remedy=_POSE_REMEDY,
        )


def _other_poses(camera: CameraModel) -> list[tuple[np.ndarray, str]]:
    """Returns the pose X_WC of the optical frame for each mistake in giving it, and the mistake."""
    x_forward, y_up, X_WC = np.eye(4), np.diag([1.0, -1.0, -1.0, 1.0]), camera.X_WC
    x_forward[:3, :3] = [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
    return [
        (X_WC @ x_forward, "its pose is that of a link (x forward, z up), not the optical frame"),
        (X_WC @ y_up, "its pose follows OpenGL (z backward, y up), not the optical frame"),
        (inverse(X_WC), "its pose is that of the world in the camera, not the reverse"),
    ]


def _median_height(points: np.ndarray, X_WC: np.ndarray) -> float:
    return float(np.median(transform_points(X_WC, points)[:, 2]))


def _flattest(heights: np.ndarray, *, below: float) -> tuple[float, float]:
    """Returns the largest share of heights (N,) [m] near one height, and this height [m]."""
    edges = np.arange(_LOWEST_FLOOR, max(below, 0.0) + 2 * _TABLE_TOLERANCE, _TABLE_TOLERANCE)
    counts = np.histogram(heights[heights < below], bins=edges)[0]
    pairs = counts[:-1] + counts[1:]
    return float(pairs.max()) / len(heights), float(edges[np.argmax(pairs) + 1])
