"""Records what cameras deliver, image by image, while it arrives on several threads."""

import queue
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.recording.demonstration.frame_grouping import median_period
from poil_drake.recording.demonstration.writer import DemonstrationWriter
from poil_drake.recording.mcap.message_encoder import ColorEncoding

_WAITING = 256
"""How many images may wait to be written: 4 s of two cameras at 30 images per second, which take
0.5 GB at 640 x 480 pixels."""

LABEL_WAIT = 2.0
"""How long the recording of a camera waits for an image with labels [s]."""


@dataclass
class CameraRecord:
    """What one camera delivered, and what of it is in the file.

    Attributes:
        stamps: Capture times of the recorded images [s].
        lost: Number of images that arrived, but could not be written.
        late: Number of images that arrived with the stamp of an earlier time, and were left out.
        recent: Capture times of the last images, recorded or not [s].
        labelled: Whether an image with labels has arrived, recorded or not.
    """

    stamps: list[float] = field(default_factory=list)
    lost: int = 0
    late: int = 0
    recent: deque[float] = field(default_factory=lambda: deque(maxlen=32))
    labelled: bool = False
    _first: float | None = None
    _begun: bool = False

    @property
    def rate(self) -> float:
        """Images per second lately; 0 if unknown."""
        stamps = list(self.recent)
        span = stamps[-1] - stamps[0] if len(stamps) > 1 else 0.0
        return (len(stamps) - 1) / span if span > 0.0 else 0.0

    @property
    def missing(self) -> int:
        """Number of images that never arrived, by the gaps between the stamps."""
        return missing_images(np.array(self.stamps))

    def begins_with(self, image: RgbdImage) -> bool:
        """Returns whether the recording begins with this image, or has begun before.

        If the camera has sent labels before, its recording begins with the next labelled image, but
        at the latest after `LABEL_WAIT`.
        """
        if self._first is None:
            self._first = image.stamp
        self._begun = (
            self._begun
            or not self.labelled
            or image.label is not None
            or image.stamp > self._first + LABEL_WAIT
        )
        return self._begun


def missing_images(stamps: np.ndarray) -> int:
    """Returns how many images are missing between the (T,) rising stamps of a regular source."""
    if len(stamps) < 3:
        return 0
    periods = np.diff(stamps) / median_period(stamps)
    return int(np.maximum(np.rint(periods) - 1, 0).sum())


class LiveRecorder:
    """Writes every image of some cameras to a new demonstration file, on its own thread.

    The file is created by `start`; images that arrive before are only counted. If a camera has sent
    labels before, its recording begins with its next labelled image, because detectors look for
    labels in the first frame. Each image keeps its own stamp.

    An image that cannot be written is counted in `CameraRecord.lost`: when the disk is too slow for
    a long time, or after an error.

    Attributes:
        records: What each camera delivered, by name.
        error: Why writing failed; None if it did not.
    """

    def __init__(
        self,
        path: str | Path,
        cameras: Sequence[CameraModel],
        metadata: Mapping[str, str],
        *,
        label_ids: Mapping[str, tuple[int, ...]] | None = None,
        scenario_text: str | None = None,
        lossless: bool = False,
    ):
        """Stores the settings.

        Args:
            path: The MCAP file, which must not exist.
            cameras: The models of the cameras, written with their first images.
            metadata: Entries for the file's metadata.
            label_ids: See `MultiViewFrame.label_ids`.
            scenario_text: The scenario as YAML, kept as an attachment.
            lossless: Whether colour is not compressed as JPEG and depth is not rounded to
                millimetres, which makes the file ten times larger.
        """
        self._path, self._cameras = Path(path), {camera.name: camera for camera in cameras}
        self._open = partial(
            DemonstrationWriter,
            path,
            list(self._cameras),
            metadata,
            label_ids=label_ids,
            scenario_text=scenario_text,
            color=ColorEncoding(format="raw") if lossless else None,
            exact_depth=lossless,
            live=True,
        )
        self.records = {name: CameraRecord() for name in self._cameras}
        self.error: Exception | None = None
        self._lock, self._started, self._closed = threading.Lock(), False, False
        self._queue: queue.Queue[tuple[str, RgbdImage] | None] = queue.Queue()

    @property
    def waiting(self) -> int:
        """Number of images that wait to be written."""
        return self._queue.qsize()

    def start(self) -> None:
        """Creates the file, and begins to record.

        Raises:
            OutputError: if the file exists.
            OSError: if it cannot be written, e.g. because the disk is full; it is then removed.
        """
        try:
            writer = self._open()
        except OSError:
            self._path.unlink(missing_ok=True)
            raise
        self._thread = threading.Thread(
            target=self._run, args=(writer,), name="live_recorder", daemon=True
        )
        self._thread.start()
        with self._lock:
            self._started = True

    def add(self, camera: str, image: RgbdImage) -> None:
        """Records an image, unless recording has not started or has ended. Never waits or raises.

        Any thread may call this, but the images of a camera must come in order.
        """
        record = self.records[camera]
        with self._lock:
            if self._closed:
                return
            earlier = bool(record.recent) and image.stamp <= record.recent[-1]
            if earlier and not self._started:
                record.recent.clear()
            if not (earlier and self._started):
                record.recent.append(image.stamp)
            record.labelled |= image.label is not None
            if not self._started:
                return
            if earlier:
                record.late += 1
            elif record.begins_with(image):
                if self.error is None and self._queue.qsize() < _WAITING:
                    self._queue.put((camera, image))
                else:
                    record.lost += 1

    def close(self) -> None:
        """Writes the images that wait, and completes the file."""
        with self._lock:
            if self._closed or not self._started:
                self._closed = True
                return
            self._closed = True
        self._queue.put(None)
        self._thread.join()

    def _run(self, writer: DemonstrationWriter) -> None:
        try:
            with writer:
                while (item := self._queue.get()) is not None:
                    self._write(writer, *item)
        except OSError as error:
            self.error = self.error or error

    def _write(self, writer: DemonstrationWriter, camera: str, image: RgbdImage) -> None:
        record = self.records[camera]
        if self.error is None:
            try:
                writer.write_image(self._cameras[camera], image)
                record.stamps.append(image.stamp)
                return
            except Exception as error:  # Reported by the thread that waits for the recording.
                self.error = error
        record.lost += 1
