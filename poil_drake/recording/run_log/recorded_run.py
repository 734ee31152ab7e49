"""A recorded run; its images stay in the log until they are needed."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from poil_drake.errors import DemonstrationError, InvalidValueError, RunLogError
from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.recording.demonstration.layout import LABEL_IDS_KEY, parse_label_ids
from poil_drake.recording.demonstration.stored_images import StoredImages
from poil_drake.recording.mcap.message_decoders import Calibration
from poil_drake.recording.run_log.series import Series

REMEDY = "Take the log that poil run or poil execute wrote, or copy it again."
"""What to do about a log that cannot be used."""

_CACHED_IMAGES = 2
"""Tracker and detector process the same image, and then the next."""


class PhaseStart(NamedTuple):
    """When a phase of the skill began [s], which one, and why."""

    time: float
    name: str
    reason: str


class LoggedTrack(NamedTuple):
    """A track and when it was logged [s]."""

    time: float
    track: TrackedPoints


@dataclass
class RecordedRun:
    """What a replay needs of a run's log, and what it is compared with.

    Attributes:
        path: The file.
        joint_names: The arm's joints, J of them.
        metadata: The metadata of the run.
        scenario_text: The scenario as YAML; None if the log lacks it.
        plan: The plan's file; None if the log lacks it.
        joints: (T, 3 J) measured positions [rad], velocities [rad/s] and external torques [Nm].
        commands: (T, J) commanded joint velocities [rad/s].
        postures: (T, J) the joint positions to which they lead [rad].
        twist: (T, 6) desired spatial velocity of the gripper, (ω [rad/s], v [m/s]) in the world.
        numbers: Topic -> (T, fields) of the statuses in `reader.NUMBERS`.
        camera_times: Camera -> (T, 1) when its newest image was captured [s].
        calibrations: Camera -> its intrinsics.
        camera_poses: Camera -> (4, 4) its pose in the world [m].
        phases: The phases of the skill.
        tracks: The tracks that the tracker released.
        images: Camera -> its images that have depth, in order.
        cut_off: How the file ends if it is cut off; empty for a whole file.
    """

    path: Path
    joint_names: tuple[str, ...]
    metadata: dict[str, str] = field(default_factory=dict)
    scenario_text: str | None = None
    plan: bytes | None = None
    joints: Series = field(default_factory=lambda: Series.of([], 21))
    commands: Series = field(default_factory=lambda: Series.of([], 7))
    postures: Series = field(default_factory=lambda: Series.of([], 7))
    twist: Series = field(default_factory=lambda: Series.of([], 6))
    numbers: dict[str, Series] = field(default_factory=dict)
    camera_times: dict[str, Series] = field(default_factory=dict)
    calibrations: dict[str, Calibration] = field(default_factory=dict)
    camera_poses: dict[str, np.ndarray] = field(default_factory=dict)
    phases: list[PhaseStart] = field(default_factory=list)
    tracks: list[LoggedTrack] = field(default_factory=list)
    images: dict[str, list[StoredImages]] = field(default_factory=dict)
    cut_off: str = ""

    @property
    def end(self) -> float:
        """The time of the last sample of the joints [s]; 0 if there is none."""
        return float(self.joints.times[-1]) if len(self.joints) else 0.0

    @property
    def label_ids(self) -> dict[str, tuple[int, ...]]:
        """The labels of objects and parts; empty if the log has none.

        Raises:
            RunLogError: if the metadata is not a table of labels.
        """
        try:
            return parse_label_ids(self.metadata.get(LABEL_IDS_KEY, "{}"))
        except InvalidValueError as error:
            raise RunLogError(f"{self.path}: {error.problem}", remedy=REMEDY) from error

    def image_reader(self, camera: CameraModel) -> Callable[[int], RgbdImage]:
        """Returns a function that decodes an image of a camera by its index in `images`.

        The function caches the last few. It raises a RunLogError if the image cannot be decoded or
        does not have the size of the camera's model, or if the file has changed.
        """
        images = self.images.get(camera.name, [])

        @lru_cache(_CACHED_IMAGES)
        def read(index: int) -> RgbdImage:
            try:
                return images[index].read(
                    self.path,
                    camera.name,
                    size=(camera.width, camera.height),
                    size_source=f"the scenario's camera '{camera.name}' has",
                )
            except DemonstrationError as error:
                raise RunLogError(
                    error.problem,
                    remedy="Copy the log again, and replay it with the cameras of the run.",
                ) from error

        return read
