"""A demonstration: what the cameras saw during one execution of the task."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from poil_drake.errors import DemonstrationError
from poil_drake.perception.images import CameraModel, MultiViewFrame
from poil_drake.recording.demonstration.checks import (
    MIN_FRAMES,
    base_frame,
    camera_names,
    check_camera,
    check_end,
    label_ids,
)
from poil_drake.recording.demonstration.contents import Contents, collect
from poil_drake.recording.demonstration.frame_grouping import group_by_stamp, median_period
from poil_drake.recording.demonstration.recorded_frames import RecordedFrames, StoredView
from poil_drake.recording.demonstration.stored_images import StoredImage, StoredImages
from poil_drake.recording.demonstration.writer import DemonstrationWriter

__all__ = ["Demonstration", "DemonstrationWriter", "LoadDemonstration", "load_demonstration"]


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
    names = camera_names(path, contents) if cameras is None else list(cameras)
    for name in names:
        check_camera(path, contents, name)
    streams = {name: contents.cameras[name] for name in names}
    check_end(path, streams)
    base = base_frame(path, contents, names)
    rows = group_by_stamp([_stamps(s) for c in streams.values() for s in (c.image, c.depth)])
    instants = [
        tuple(
            _view(contents, name, base=base, image=int(image), depth=int(depth))
            for name, (image, depth) in zip(names, row.reshape(-1, 2), strict=True)
        )
        for row in rows
    ]
    frames = RecordedFrames(path, instants, label_ids(path, contents))
    demonstration = Demonstration(frames, contents.metadata, contents.scenario_text, name=str(path))
    # Decoding one frame finds wrong encodings and sizes now rather than in the middle of a job.
    _ = demonstration.cameras
    return demonstration


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


LoadDemonstration = load_demonstration
"""Alias of `load_demonstration`, named in the style of `RecordDemonstration`."""
