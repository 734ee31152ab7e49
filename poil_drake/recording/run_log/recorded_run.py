"""A recorded run: its signals, and its images, which stay in the log until they are needed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

from poil_drake.errors import DemonstrationError, RunLogError
from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.recording.demonstration.layout import parse_label_ids
from poil_drake.recording.demonstration.stored_images import StoredImages
from poil_drake.recording.mcap.message_decoders import Calibration

REMEDY = "Use a log that poil run or poil execute wrote, or copy the log again."
"""What to do if a log cannot be used."""

_CACHED_IMAGES = 2
"""Number of decoded images to keep. The tracker and the detector share each image."""

ROUNDING = 1e-9
"""Tolerance for the rounding of times to nanoseconds [s]."""


@dataclass(frozen=True, eq=False)
class Series:
    """Samples in chronological order.

    Attributes:
        times: (T,) times of the samples [s].
        values: (T, N) samples, one per row.
    """

    times: np.ndarray
    values: np.ndarray

    @classmethod
    def of(cls, samples: Sequence[tuple[float, Sequence[float] | np.ndarray]], size: int) -> Self:
        """Makes a series from unordered (time [s], sample) pairs with `size` values per sample."""
        ordered = sorted(samples, key=lambda sample: sample[0])
        times = np.array([time for time, _ in ordered], dtype=float)
        return cls(times, np.array([value for _, value in ordered], float).reshape(-1, size))

    def __len__(self) -> int:
        return len(self.times)

    @property
    def period(self) -> float:
        """Median time between the samples [s]; NaN if there are fewer than two."""
        return float(np.median(np.diff(self.times))) if len(self) > 1 else float("nan")

    def at(self, time: float) -> np.ndarray:
        """Returns the (N,) newest sample at or before a time [s]; NaN if there is none."""
        index = np.searchsorted(self.times, time + ROUNDING, side="right") - 1
        return np.full(self.values.shape[1:], np.nan) if index < 0 else self.values[index]


class PhaseStart(NamedTuple):
    """The start of a phase of the skill: the time [s], the phase's name, and the reason."""

    time: float
    name: str
    reason: str


class LoggedTrack(NamedTuple):
    """A track, and the time when it was logged [s]."""

    time: float
    track: TrackedPoints


@dataclass
class RecordedRun:
    """The parts of a run's log that a replay needs or is compared with.

    Attributes:
        path: The file.
        joint_names: Names of the arm's J joints.
        metadata: The metadata of the run.
        scenario_text: The scenario as YAML; None if the log lacks it.
        plan: The contents of the plan file; None if the log lacks it.
        joints: (T, 3 J) measured positions [rad], velocities [rad/s] and external torques [Nm].
        commands: (T, J) commanded joint velocities [rad/s].
        postures: (T, J) commanded joint positions [rad].
        twist: (T, 6) commanded spatial velocity of the gripper, (ω [rad/s], v [m/s]) in the world.
        numbers: Topic -> (T, F) values of the fields that `reader.NUMBERS` lists for the topic.
        camera_times: Camera -> (T, 1) capture time of its newest image [s].
        calibrations: Camera -> its intrinsics.
        camera_poses: Camera -> (4, 4) pose of the camera in the world [m].
        phases: The phases of the skill.
        tracks: The tracks that the tracker output, sorted by stamp.
        images: Camera -> its images with both colour and depth, in the order of logging.
        cut_off: A sentence, without its full stop, that says where the file is cut off; empty if
            the file is complete.
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
        """The render labels of objects and parts; empty if the log has none.

        Raises:
            RunLogError: if the metadata `label_ids` is not a JSON object of label lists.
        """
        try:
            return parse_label_ids(self.path, self.metadata)
        except DemonstrationError as error:
            raise RunLogError(error.problem, remedy=REMEDY) from error

    def image_reader(self, camera: CameraModel) -> Callable[[int], RgbdImage]:
        """Returns a function that decodes image k of the camera, i.e. `images[camera.name][k]`.

        The function caches the last two images. It raises a RunLogError if the image cannot be
        decoded or does not have the size of `camera`, or if the file has changed.
        """
        images = self.images.get(camera.name, [])
        lens = Calibration("", camera.width, camera.height, camera.K, distortion=np.zeros(0))

        @lru_cache(_CACHED_IMAGES)
        def read(index: int) -> RgbdImage:
            try:
                return images[index].read(self.path, camera.name, lens)
            except DemonstrationError as error:
                raise RunLogError(
                    error.problem,
                    remedy="Set the camera's image size to that of the run, or copy the log again.",
                ) from error

        return read
