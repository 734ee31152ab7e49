"""A demonstration: what the cameras saw during one execution of the task."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from poil_drake.errors import CaptureError, DemonstrationError, InvalidValueError
from poil_drake.perception.images import CameraModel, MultiViewFrame
from poil_drake.perception.plausibility import check_plausible
from poil_drake.recording.demonstration.contents import CameraContents, Contents, collect
from poil_drake.recording.demonstration.frame_grouping import group_by_stamp, median_period
from poil_drake.recording.demonstration.frame_tree import FrameTree
from poil_drake.recording.demonstration.layout import (
    CAMERAS_KEY,
    STATIC_TRANSFORM_TOPIC,
    TRANSFORM_TOPIC,
    WORLD_FRAME,
    WORLD_FRAME_KEY,
    camera_topic,
    parse_label_ids,
)
from poil_drake.recording.demonstration.stamp_checks import (
    check_stamps,
    in_order,
    lack_stamps,
    stamped_by_log_time,
)
from poil_drake.recording.demonstration.stored_images import (
    RecordedFrames,
    Registration,
    StoredImage,
    StoredImages,
    StoredView,
)
from poil_drake.recording.mcap.message_decoders import Calibration
from poil_drake.recording.mcap.timestamps import to_nanoseconds, to_seconds

_MIN_FRAMES = 2
# The end of the demonstration shows the goal, so no camera may stop much before the others.
_MAX_MISSING_END = 0.5  # [s]
# In the name of the frame of depth that the driver of a RealSense has registered to colour.
_REALSENSE_REGISTERED = "aligned_depth_to_color"
# Segmenters stamp their answer late, when the object is still at rest.
_MAX_LABEL_DELAY = 1.0  # [s] from the first image to its label image


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
        if len(self.frames) < _MIN_FRAMES:
            raise DemonstrationError(
                f"{self.name} needs at least {_MIN_FRAMES} frames in which all cameras have colour "
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


def load_demonstration(path: str | Path, *, cameras: Sequence[str] | None = None) -> Demonstration:
    """Loads a demonstration in the layout of docs/demonstration_format.md.

    The file is read once and checked; images are decoded when they are accessed.

    Args:
        path: The MCAP file.
        cameras: The cameras to use; by default all in the file.

    Raises:
        DemonstrationError: if the file is missing, damaged or incomplete. The message names the
            file, the topic and the remedy.
    """
    path = Path(path)
    contents = collect(path)
    names = _camera_names(path, contents) if cameras is None else list(cameras)
    for name in names:
        _check_camera(path, contents, name)
    cameras_used = {name: contents.cameras[name] for name in names}
    _settle_stamps(path, contents.frames, cameras_used)
    _check_end(path, cameras_used)
    base = _base_frame(path, contents, names)
    streams = [_stamps(s) for c in cameras_used.values() for s in (c.image, c.depth)]
    rows = _with_poses(path, contents, names, base=base, rows=group_by_stamp(streams))
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
    demonstration.check_plausible()
    return demonstration


LoadDemonstration = load_demonstration
"""Alias of `load_demonstration`, named in the style of `RecordDemonstration`."""


def _settle_stamps(path: Path, frames: FrameTree, cameras: Mapping[str, CameraContents]) -> None:
    """Checks the stamps of the cameras' images, then sorts the images by stamp.

    If a topic has no stamps, the times of logging become the stamps of everything.

    Raises:
        DemonstrationError: if the stamps are wrong.
    """
    unstamped = lack_stamps(_color_and_depth(cameras))
    if unstamped:
        frames.use_log_times()
    for camera in cameras.values():
        labels_unstamped = camera.image[0].stamp and not any(i.stamp for i in camera.label)
        for kind in ("image", "depth", "label"):
            if unstamped or (kind == "label" and labels_unstamped):
                setattr(camera, kind, stamped_by_log_time(getattr(camera, kind)))
    check_stamps(path, _color_and_depth(cameras))
    for camera in cameras.values():
        for kind in ("image", "depth", "label"):
            setattr(camera, kind, in_order(getattr(camera, kind)))


def _color_and_depth(cameras: Mapping[str, CameraContents]) -> dict[str, list[StoredImage]]:
    return {
        camera_topic(name, kind): getattr(camera, kind)
        for name, camera in cameras.items()
        for kind in ("image", "depth")
    }


def _with_poses(
    path: Path, contents: Contents, names: Sequence[str], *, base: str, rows: np.ndarray
) -> np.ndarray:
    """Returns the rows of `group_by_stamp` at whose times the poses of all cameras are known.

    Raises:
        DemonstrationError: if this leaves out more than `_MAX_MISSING_END`.
    """
    known = np.ones(len(rows), dtype=bool)
    for column, name in enumerate(names if len(rows) else ()):
        camera = contents.cameras[name]
        first, last = contents.frames.span(base=base, frame=camera.frame_id)
        stamps = _stamps(camera.image)[rows[:, 2 * column]]
        start, end = int(stamps[0]), int(stamps[-1])
        gap = to_seconds(max(first - start, end - last))
        if gap > _MAX_MISSING_END:
            raise DemonstrationError(
                f"{path}: frame '{camera.frame_id}' of camera '{name}' moves, but its transforms "
                f"reach from {to_seconds(first):.3f} s to {to_seconds(last):.3f} s and its images "
                f"from {to_seconds(start):.3f} s to {to_seconds(end):.3f} s, a gap of {gap:.2f} s.",
                remedy="Record the transforms during the whole motion, on the clock of the images.",
            )
        known &= (stamps >= first) & (stamps <= last)
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
        registration = None
        if camera.depth_calibration:
            X_CD = frames.pose(
                base=camera.frame_id, frame=camera.depth_frame_id, stamp=stored_depth.stamp
            )
            lens = _calibration_at(camera.depth_calibration, stored_depth.stamp)
            registration = Registration(lens, X_CD)
        after = tolerance if views else to_nanoseconds(_MAX_LABEL_DELAY)
        label = min(camera.label, key=lambda label: abs(label.stamp - color.stamp), default=None)
        if label and not -tolerance < label.stamp - color.stamp < after:
            label = None
        views.append(
            StoredView(
                name,
                _calibration_at(camera.calibration, color.stamp),
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


def _camera_names(path: Path, contents: Contents) -> list[str]:
    """Returns the camera names: those in the metadata, in that order, then any others, sorted."""
    text = contents.metadata.get(CAMERAS_KEY, "[]")
    try:
        listed = json.loads(text)
    except json.JSONDecodeError:
        listed = None
    if not isinstance(listed, list):
        raise DemonstrationError(
            f"{path}: the metadata '{CAMERAS_KEY}' is not a JSON list: {text[:80]}",
            remedy='Use a list of camera names, e.g. ["left", "right"].',
        )
    names = list(dict.fromkeys([*map(str, listed), *sorted(contents.cameras)]))
    if not names:
        raise DemonstrationError(
            f"{path} has no camera: no topic is named {camera_topic('<name>', 'image')}.",
            remedy="Record colour, depth and calibration of each camera, as described in "
            "docs/demonstration_format.md.",
        )
    return names


def _check_camera(path: Path, contents: Contents, name: str) -> None:
    """Raises a DemonstrationError unless a camera has calibration, colour and registered depth."""
    camera, kinds = contents.cameras.get(name, CameraContents()), ("image", "depth", "calibration")
    present = " and ".join(kind for kind in kinds if getattr(camera, kind)) or "no other topic"
    for kind in kinds:
        messages, topic = getattr(camera, kind), camera_topic(name, kind)
        if not messages:
            raise DemonstrationError(
                f"{path}: camera '{name}' has no topic {topic}; it has {present}. Cameras in the "
                f"file: {', '.join(repr(c) for c in sorted(contents.cameras)) or 'none'}.",
                remedy="Record colour, depth and calibration of each camera, or select a camera "
                "that has all three.",
            )
        if kind != "calibration" and len(messages) < _MIN_FRAMES:
            raise DemonstrationError(
                f"{path}: topic {topic} has only {len(messages)} message, but at least "
                f"{_MIN_FRAMES} are needed.",
                remedy="Record the whole motion.",
            )
    color_frame, depth_frame = camera.image[0].frame_id, camera.depth[0].frame_id
    if camera.depth_calibration:
        color_frame, depth_frame = camera.frame_id, camera.depth_frame_id
        if not contents.frames.connected(base=color_frame, frame=depth_frame):
            raise DemonstrationError(
                f"{path}: no transform connects the depth images' frame '{depth_frame}' with the "
                f"colour images' frame '{color_frame}' of camera '{name}'.",
                remedy=f"Record this transform on {STATIC_TRANSFORM_TOPIC}.",
            )
    elif not _registered(contents.frames, color_frame, depth_frame):
        raise DemonstrationError(
            f"{path}: the depth images of camera '{name}' are in frame '{depth_frame}', but its "
            f"colour images are in frame '{color_frame}'.",
            remedy="Record depth registered to colour (e.g. aligned_depth_to_color), or also the "
            f"depth images' own calibration on {camera_topic(name, 'depth_calibration')}.",
        )


def _registered(frames: FrameTree, color_frame: str, depth_frame: str) -> bool:
    """Returns whether images in the two frames are in one view, as far as the names tell."""
    if not color_frame or not depth_frame or color_frame == depth_frame:
        return True
    if _REALSENSE_REGISTERED in depth_frame:
        return True
    if not frames.connected(base=color_frame, frame=depth_frame):
        return False
    X_CD = frames.pose(base=color_frame, frame=depth_frame, stamp=0)
    return np.allclose(X_CD, np.eye(4), rtol=0.0, atol=1e-6)


def _check_end(path: Path, cameras: Mapping[str, CameraContents]) -> None:
    """Raises a DemonstrationError if a topic ends `_MAX_MISSING_END` before the last one."""
    ends = {
        topic: to_seconds(stream[-1].stamp) for topic, stream in _color_and_depth(cameras).items()
    }
    end = max(ends.values())
    for topic, last in ends.items():
        if end - last > _MAX_MISSING_END:
            raise DemonstrationError(
                f"{path}: topic {topic} stops {end - last:.2f} s before the recording ends.",
                remedy="Record all cameras until the end, which shows the goal. If the cameras' "
                "clocks differ, correct the timestamps.",
            )


def _base_frame(path: Path, contents: Contents, names: Sequence[str]) -> str:
    """Returns the name of the world frame.

    This is the frame named in the metadata, or else "world" if the file has such a frame, or else
    the root of the transform tree that holds the first camera.

    Raises:
        DemonstrationError: if a camera has no pose in the world frame.
    """
    frames = contents.frames
    optical = {name: contents.cameras[name].frame_id for name in names}
    base = contents.metadata.get(WORLD_FRAME_KEY, WORLD_FRAME)
    if base not in frames and WORLD_FRAME_KEY not in contents.metadata:
        root = frames.root(optical[names[0]])
        base = root if root != optical[names[0]] else base
    for name, frame in optical.items():
        if not frames.connected(base=base, frame=frame):
            raise DemonstrationError(
                f"{path}: no transform connects frame '{base}' with frame '{frame}' of camera "
                f"'{name}'.",
                remedy=f"Record a foxglove.FrameTransform on {TRANSFORM_TOPIC} whose child frame "
                "is the calibration's frame_id.",
            )
    return base
