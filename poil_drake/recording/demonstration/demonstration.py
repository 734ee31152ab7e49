"""A demonstration: what the cameras saw during one execution of the task."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from poil_drake.errors import CaptureError, DemonstrationError, InvalidValueError
from poil_drake.perception.images import CameraModel, MultiViewFrame
from poil_drake.perception.plausibility import check_plausible
from poil_drake.recording.demonstration.completeness_checks import (
    MAX_MISSING_END,
    MIN_FRAMES,
    base_frame,
    camera_names,
    check_camera,
    check_end,
)
from poil_drake.recording.demonstration.contents import Contents, collect
from poil_drake.recording.demonstration.frame_grouping import group_by_stamp, median_period
from poil_drake.recording.demonstration.layout import parse_label_ids
from poil_drake.recording.demonstration.stamp_checks import color_and_depth, settle_stamps
from poil_drake.recording.demonstration.stored_images import (
    RecordedFrames,
    Registration,
    StoredImage,
    StoredImages,
    StoredView,
)
from poil_drake.recording.mcap.message_decoders import Calibration
from poil_drake.recording.mcap.timestamps import to_nanoseconds, to_seconds

# Segmenters stamp their answer late, when the object is still at rest.
_MAX_LABEL_DELAY = 1.0  # [s] between the first image and its label image


@dataclass(frozen=True, eq=False)
class Demonstration:
    """One demonstration.

    Attributes:
        frames: At least two frames, sorted by stamp. Frames in a file are decoded when accessed.
        metadata: What the recorder wrote about the demonstration; may be empty.
        scenario_text: The scenario in which it was recorded, as YAML; None if the file has none.
        name: Its name in error messages; the path, if it was loaded from a file.
    """

    frames: Sequence[MultiViewFrame]
    metadata: Mapping[str, str] = field(default_factory=dict)
    scenario_text: str | None = None
    name: str = "demonstration"

    def __post_init__(self) -> None:
        if len(self.frames) < MIN_FRAMES:
            raise DemonstrationError(
                f"{self.name} needs at least {MIN_FRAMES} frames in which all cameras have colour "
                f"and depth, but has {len(self.frames)}.",
                remedy="Record the whole motion with all cameras running at the same time.",
            )

    @property
    def cameras(self) -> tuple[CameraModel, ...]:
        """The models of the cameras in the first frame."""
        return self.frames[0].cameras

    @property
    def stamps(self) -> np.ndarray:
        """The (T,) capture times of the frames [s]."""
        if isinstance(self.frames, RecordedFrames):
            return self.frames.stamps
        return np.array([frame.stamp for frame in self.frames])

    @property
    def duration(self) -> float:
        """The time from the first to the last frame [s]."""
        return float(np.ptp(self.stamps))

    def check_plausible(self, *, table_height: float | None = None) -> None:
        """Checks by the first frame that units of depth and camera poses can be right.

        Args:
            table_height: Height of the table [m, world]; None if it is not known.

        Raises:
            DemonstrationError: if they cannot, or if the frame cannot be decoded.
        """
        try:
            check_plausible(self.frames[0], table_height=table_height)
        except CaptureError as error:
            raise DemonstrationError(
                f"{self.name}: {error.problem}", remedy=error.remedy
            ) from error


def load_demonstration(
    path: str | Path, *, cameras: Sequence[str] | None = None, plausible: bool = True
) -> Demonstration:
    """Loads a demonstration in the layout of docs/demonstration_format.md.

    The file is read once and checked; images are decoded when they are accessed.

    Args:
        path: The MCAP file.
        cameras: The cameras to use; by default all in the file.
        plausible: Whether to refuse implausible depth and camera poses.

    Raises:
        DemonstrationError: if the file is missing, damaged or incomplete. The message names the
            file, the topic and the remedy.
    """
    path = Path(path)
    contents = collect(path)
    names = camera_names(path, contents) if cameras is None else list(cameras)
    for name in names:
        check_camera(path, contents, name)
    cameras_used = {name: contents.cameras[name] for name in names}
    settle_stamps(path, contents.frames, cameras_used)
    rows = group_by_stamp([_stamps(s) for s in color_and_depth(cameras_used).values()])
    check_end(path, cameras_used, rows)
    base = base_frame(path, contents, names)
    rows = _with_poses(path, contents, names, base=base, rows=rows)
    try:
        views = [
            _views(contents, name, base, rows[:, 2 * i : 2 * i + 2]) for i, name in enumerate(names)
        ]
    except InvalidValueError as error:
        raise DemonstrationError(f"{path}: {error.problem}", remedy=error.remedy) from error
    frames = RecordedFrames(
        path, list(zip(*views, strict=True)), parse_label_ids(path, contents.metadata)
    )
    demonstration = Demonstration(frames, contents.metadata, contents.scenario_text, name=str(path))
    if plausible:
        demonstration.check_plausible()
    return demonstration


LoadDemonstration = load_demonstration
"""Alias of `load_demonstration`, named in the style of `RecordDemonstration`."""


def _with_poses(
    path: Path, contents: Contents, names: Sequence[str], *, base: str, rows: np.ndarray
) -> np.ndarray:
    """Returns the rows of `group_by_stamp` at whose times the poses of all cameras are known.

    As with a camera that starts late, the demonstration starts when all poses are known.

    Raises:
        DemonstrationError: if this leaves out everything, or more than `MAX_MISSING_END` at the
            end, which shows the goal.
    """
    known = np.ones(len(rows), dtype=bool)
    for column, name in enumerate(names if len(rows) else ()):
        camera = contents.cameras[name]
        first, last = contents.frames.span(base=base, frame=camera.frame_id)
        stamps = _stamps(camera.image)[rows[:, 2 * column]]
        start, end = int(stamps[0]), int(stamps[-1])
        inside = (stamps >= first) & (stamps <= last)
        if not inside.any() or to_seconds(end - last) > MAX_MISSING_END:
            gap = to_seconds(max(first - start, end - last))
            raise DemonstrationError(
                f"{path}: frame '{camera.frame_id}' of camera '{name}' moves, but its transforms "
                f"reach from {to_seconds(first):.3f} s to {to_seconds(last):.3f} s and its images "
                f"from {to_seconds(start):.3f} s to {to_seconds(end):.3f} s, a gap of {gap:.2f} s.",
                remedy="Record the transforms during the whole motion, on the clock of the images.",
            )
        known &= inside
    return rows[known]


def _views(contents: Contents, name: str, base: str, rows: np.ndarray) -> list[StoredView]:
    """Returns the views of one camera.

    Args:
        contents: The contents of the file.
        name: The camera's name.
        base: The world frame.
        rows: (F, 2) indices of colour and depth image at each instant.
    """
    camera, frames = contents.cameras[name], contents.frames
    tolerance = 0.5 * median_period(_stamps(camera.image))
    views: list[StoredView] = []
    for image, depth in rows:
        color, stored_depth = camera.image[image], camera.depth[depth]
        lens = _calibration_at(camera.calibration, color.stamp)
        registration = None
        if camera.depth_calibration:
            X_CD = frames.pose(
                base=camera.frame_id, frame=camera.depth_frame_id, stamp=stored_depth.stamp
            )
            depth_lens = _calibration_at(camera.depth_calibration, stored_depth.stamp)
            if not (depth_lens.same_view(lens) and np.allclose(X_CD, np.eye(4), atol=1e-6)):
                registration = Registration(depth_lens, X_CD)
        limit = tolerance if views else to_nanoseconds(_MAX_LABEL_DELAY)
        label = min(camera.label, key=lambda label: abs(label.stamp - color.stamp), default=None)
        if label and abs(label.stamp - color.stamp) >= limit:
            label = None
        views.append(
            StoredView(
                name,
                lens,
                frames.pose(base=base, frame=camera.frame_id, stamp=color.stamp),
                StoredImages(color, stored_depth, label),
                registration,
            )
        )
    return views


def _calibration_at(entries: Sequence[tuple[int, Calibration]], stamp: int) -> Calibration:
    """Returns the last calibration at or before a time [ns], or the first one."""
    past = [calibration for since, calibration in entries if since <= stamp]
    return past[-1] if past else entries[0][1]


def _stamps(images: Sequence[StoredImage]) -> np.ndarray:
    return np.array([image.stamp for image in images], dtype=np.int64)
