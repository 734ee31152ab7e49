"""A demonstration: what the cameras saw during one execution of the task."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from poil_drake.errors import DemonstrationError
from poil_drake.perception.images import CameraModel, MultiViewFrame
from poil_drake.recording.demonstration.contents import CameraContents, Contents, collect
from poil_drake.recording.demonstration.frame_grouping import group_by_stamp, median_period
from poil_drake.recording.demonstration.layout import (
    CAMERAS_KEY,
    TRANSFORM_TOPIC,
    WORLD_FRAME,
    WORLD_FRAME_KEY,
    camera_topic,
    parse_label_ids,
)
from poil_drake.recording.demonstration.stored_images import (
    RecordedFrames,
    StoredImage,
    StoredImages,
    StoredView,
)
from poil_drake.recording.mcap.timestamps import to_seconds

_MIN_FRAMES = 2
# The end of the demonstration shows the goal, so no camera may stop much before the others.
_MAX_MISSING_END = 0.5  # [s]


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
    streams = {name: contents.cameras[name] for name in names}
    _check_end(path, streams)
    base = _base_frame(path, contents, names)
    rows = group_by_stamp([_stamps(s) for c in streams.values() for s in (c.image, c.depth)])
    instants = [
        tuple(
            _view(contents, name, base=base, image=int(image), depth=int(depth))
            for name, (image, depth) in zip(names, row.reshape(-1, 2), strict=True)
        )
        for row in rows
    ]
    frames = RecordedFrames(path, instants, parse_label_ids(path, contents.metadata))
    demonstration = Demonstration(frames, contents.metadata, contents.scenario_text, name=str(path))
    # Decoding one frame finds wrong encodings and sizes now rather than in the middle of a job.
    _ = demonstration.cameras
    return demonstration


LoadDemonstration = load_demonstration
"""Alias of `load_demonstration`, named in the style of `RecordDemonstration`."""


def _view(contents: Contents, name: str, *, base: str, image: int, depth: int) -> StoredView:
    camera = contents.cameras[name]
    color = camera.image[image]
    past = [calibration for stamp, calibration in camera.calibration if stamp <= color.stamp]
    calibration = past[-1] if past else camera.calibration[0][1]
    X_WC = contents.frames.pose(base=base, frame=camera.frame_id, stamp=color.stamp)
    assert X_WC is not None
    label = min(camera.label, key=lambda image: abs(image.stamp - color.stamp), default=None)
    if label and 2 * abs(label.stamp - color.stamp) >= median_period(_stamps(camera.image)):
        label = None
    images = StoredImages(color, camera.depth[depth], label)
    return StoredView(name, calibration, X_WC, images)


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
    if color_frame and depth_frame and color_frame != depth_frame:
        raise DemonstrationError(
            f"{path}: the depth images of camera '{name}' are in frame '{depth_frame}', but its "
            f"colour images are in frame '{color_frame}'.",
            remedy="Record depth registered to colour (e.g. aligned_depth_to_color).",
        )


def _check_end(path: Path, streams: Mapping[str, CameraContents]) -> None:
    """Raises a DemonstrationError if a topic ends `_MAX_MISSING_END` before the last one."""
    ends = {
        camera_topic(name, kind): to_seconds(stream[-1].stamp)
        for name, camera in streams.items()
        for kind, stream in (("image", camera.image), ("depth", camera.depth))
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
        if frames.pose(base=base, frame=frame, stamp=0) is None:
            raise DemonstrationError(
                f"{path}: no transform connects frame '{base}' with frame '{frame}' of camera "
                f"'{name}'.",
                remedy=f"Record a foxglove.FrameTransform on {TRANSFORM_TOPIC} whose child frame "
                "is the calibration's frame_id.",
            )
    return base
