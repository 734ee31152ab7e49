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
from poil_drake.recording.demonstration.writer import DemonstrationWriter, encode_image
from poil_drake.recording.mcap.message_encoder import ColorEncoding, EncodedMessage, MessageEncoder

_WAITING = 256
"""How many images may wait to be written: 4 s of two cameras at 30 images per second, which take
0.2 GB at 640 x 480 pixels."""

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
        encoded: Whether an image has been chosen for the file.
    """

    stamps: list[float] = field(default_factory=list)
    lost: int = 0
    late: int = 0
    recent: deque[float] = field(default_factory=lambda: deque(maxlen=32))
    labelled: bool = False
    encoded: bool = False
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
        if len(self.stamps) < 3:
            return 0
        periods = np.diff(self.stamps) / median_period(np.array(self.stamps))
        return int(np.maximum(np.rint(periods) - 1, 0).sum())

    def begins_with(self, image: RgbdImage) -> bool:
        """Returns whether the recording begins with this image, or has begun before.

        Detectors look for labels in the first frame. If the camera has sent labels before, its
        recording begins with the next labelled image, but at the latest after `LABEL_WAIT`.
        """
        self._first = image.stamp if self._first is None else self._first
        waited = image.stamp - self._first > LABEL_WAIT
        self._begun |= waited or not self.labelled or image.label is not None
        return self._begun


_Item = tuple[CameraRecord, float, Mapping[str, EncodedMessage]]
"""The record of a camera, and the stamp [s] and messages of one of its images."""


class LiveRecorder:
    """Writes every image of some cameras to a new demonstration file.

    Each camera's thread encodes its images, and one thread writes them. The file is created by
    `start`; images that arrive before are only counted. Each image keeps its own stamp. Images that
    cannot be written, because the machine is too slow for seconds or after an error, are lost.

    Attributes:
        path: The file.
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
                millimetres, which makes the file several times larger.
        """
        self.path, self._cameras = Path(path), {camera.name: camera for camera in cameras}
        self._open = partial(
            DemonstrationWriter,
            path,
            list(self._cameras),
            metadata,
            label_ids=label_ids,
            scenario_text=scenario_text,
            live=True,
        )
        color = ColorEncoding(format="raw") if lossless else None
        self._encoders = {
            name: MessageEncoder(color=color, exact_depth=lossless) for name in self._cameras
        }
        self.records = {name: CameraRecord() for name in self._cameras}
        self.error: Exception | None = None
        self._lock, self._started, self._closed = threading.Lock(), False, False
        self._queue: queue.Queue[_Item | None] = queue.Queue()

    def start(self) -> None:
        """Creates the file, and begins to record.

        Raises:
            OutputError: if the file exists.
            OSError: if it cannot be written, e.g. because the disk is full; it is then removed.
        """
        try:
            writer = self._open()
        except OSError:
            self.path.unlink(missing_ok=True)
            raise
        self._thread = threading.Thread(
            target=self._run, args=(writer,), name="live_recorder", daemon=True
        )
        self._thread.start()
        with self._lock:
            self._started = True

    def add(self, camera: str, image: RgbdImage) -> None:
        """Records an image, unless recording has not started or has ended. Never waits or raises.

        Only one thread may call this for a camera.
        """
        record = self.records[camera]
        with self._lock:
            if not self._wants(record, image):
                return
            is_first = not record.encoded
            record.encoded = True
        try:
            model = self._cameras[camera]
            messages = encode_image(self._encoders[camera], model, image, calibration=is_first)
        except Exception as error:  # Reported by the thread that waits.
            self.error = error
            record.lost += 1
        else:
            self._queue.put((record, image.stamp, messages))

    def _wants(self, record: CameraRecord, image: RgbdImage) -> bool:
        """Returns whether to record an image, and counts it."""
        earlier = bool(record.recent) and image.stamp <= record.recent[-1]
        if self._closed or (earlier and self._started):
            record.late += not self._closed
            return False
        if earlier:  # The clock went back before the recording.
            record.recent.clear()
        record.recent.append(image.stamp)
        record.labelled |= image.label is not None
        if not (self._started and record.begins_with(image)):
            return False
        has_room = self.error is None and self._queue.qsize() < _WAITING
        record.lost += not has_room
        return has_room

    def close(self) -> None:
        """Writes the images that wait, and completes the file."""
        with self._lock:
            is_running = self._started and not self._closed
            self._closed = True
        if is_running:
            self._queue.put(None)
            self._thread.join()

    def _run(self, writer: DemonstrationWriter) -> None:
        try:
            with writer:
                while (item := self._queue.get()) is not None:
                    record, stamp, messages = item
                    try:
                        if self.error is None:
                            writer.write_messages(messages, stamp=stamp)
                    except Exception as error:  # Reported by the thread that waits.
                        self.error = error
                    if self.error is None:
                        record.stamps.append(stamp)
                    else:
                        record.lost += 1
        except OSError as error:
            self.error = self.error or error
