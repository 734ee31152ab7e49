"""Plays back a recorded camera in real time."""

import time
from collections.abc import Mapping, Sequence

import numpy as np

from poil_drake.errors import (
    CaptureError,
    DemonstrationError,
    InvalidValueError,
    NoImageError,
    NoMoreImagesError,
)
from poil_drake.perception.capture.checks import check_same_view
from poil_drake.perception.capture.config import McapPlayback
from poil_drake.perception.capture.device import PATIENCE, Clock
from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.recording.demonstration.demonstration import Demonstration, load_demonstration
from poil_drake.recording.demonstration.frame_grouping import median_period
from poil_drake.recording.demonstration.relabelling import relabelled
from poil_drake.recording.demonstration.stored_images import RecordedFrames
from poil_drake.runtime.interpreter_turns import TURNS


class CameraPlayback:
    """A `CaptureDevice` that plays back one camera of a demonstration or run log.

    An image is decoded when it is due; if several are due, all but the latest are skipped, unless
    every image is wanted. See `McapPlayback` for the meaning of the stamps. The constructor does
    not open the file.

    Args:
        config: The file, and how to play it.
        camera: The camera's model in the scenario; its intrinsics must match the recording.
        clock: Returns the current time [s since the epoch].
        label_ids: The scenario's labels, see `MultiViewFrame.label_ids`; the recorded label images
            are translated to their numbers. None keeps the recorded numbers.
        every_image: Whether images that are due are read one after the other, even if late.

    Raises:
        InvalidValueError: if no file is given.
    """

    def __init__(
        self,
        config: McapPlayback,
        *,
        camera: CameraModel,
        clock: Clock,
        label_ids: Mapping[str, Sequence[int]] | None = None,
        every_image: bool = False,
    ):
        if not config.file:
            raise InvalidValueError(
                f"McapPlayback.file of camera '{camera.name}' is empty.",
                remedy="Set it to a demonstration or to the log of a run.",
            )
        self._config, self._camera, self._clock = config, camera, clock
        self._label_ids = label_ids
        self._every_image = every_image
        self._source = f"Camera '{camera.name}'"
        self._recording: Demonstration | None = None
        self._offsets = np.zeros(0)
        self._cycle = 0.0
        self._start: float | None = None
        self._played = -1

    def open(self) -> None:
        """Opens and checks the recording; see `CaptureDevice.open`."""
        if self._start is None:
            self._start = self._clock() + self._config.lead_in
        try:
            recording = load_demonstration(
                self._config.file, cameras=[self._config.camera or self._camera.name]
            )
        except DemonstrationError as error:
            raise CaptureError(f"{self._source}: {error.problem}", remedy=error.remedy) from error
        self._check(recording)
        stamps = recording.stamps
        self._offsets = (stamps - stamps[0]) / self._config.rate
        self._cycle = float(self._offsets[-1] + median_period(self._offsets))
        self._recording = recording

    def read(self) -> RgbdImage | None:
        """Returns the image that is due, or None if none is; see `CaptureDevice.read`."""
        if self._recording is None or self._start is None:
            raise CaptureError(f"{self._source} is not open.", remedy="Open it first.")
        number = self._due(self._clock() - self._start)
        if number <= self._played:
            ahead = self._start + self._time_of(number + 1) - self._clock()
            time.sleep(min(max(ahead, 0.0), PATIENCE))
            number = self._due(self._clock() - self._start)
        if number <= self._played:
            if self._time_of(number + 1) == np.inf:
                raise NoMoreImagesError(
                    f"{self._source}: {self._config.file} has ended.",
                    remedy="Play it in a loop (loop: true), or use a longer recording.",
                )
            return None
        if self._every_image:
            number = self._played + 1
        self._played = number
        TURNS.wait()
        try:
            frame = self._recording.frames[number % len(self._offsets)]
            image = frame.images[0]
        except DemonstrationError as error:
            raise NoImageError(f"{self._source}: {error.problem}", remedy=error.remedy) from error
        label = image.label
        if label is not None and self._label_ids is not None:
            label = relabelled(label, frame.label_ids, self._label_ids)
        return RgbdImage(image.rgb, image.depth, self._start + self._time_of(number), label=label)

    def close(self) -> None:
        """Releases the recording; see `CaptureDevice.close`."""
        self._recording = None

    def _check(self, recording: Demonstration) -> None:
        """Raises a CaptureError if the recording does not match the scenario."""
        file = self._config.file
        check_same_view(recording.cameras[0], self._camera, source=f"{self._source} in {file}")
        frames = recording.frames
        if self._config.labels and isinstance(frames, RecordedFrames) and not frames.labelled:
            raise CaptureError(
                f"{self._source}: {file} has no label images of this camera.",
                remedy="Set labels: false, or use a recording with label images.",
            )

    def _due(self, elapsed: float) -> int:
        """Returns the number of the image due at `elapsed` [s], counted through all loops."""
        count = len(self._offsets)
        loops = max(int(elapsed // self._cycle), 0) if self._config.loop else 0
        within = elapsed - loops * self._cycle
        return loops * count + int(np.searchsorted(self._offsets, within, side="right")) - 1

    def _time_of(self, number: int) -> float:
        """Returns when image `number` is due [s from the start]; infinity after the last one."""
        loops, index = divmod(number, len(self._offsets))
        if loops > 0 and not self._config.loop:
            return np.inf
        return loops * self._cycle + float(self._offsets[index])
