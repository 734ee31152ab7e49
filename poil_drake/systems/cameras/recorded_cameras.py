"""Cameras that show the images of a recorded run."""

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import Context, LeafSystem

from poil_drake.perception.images import RgbdImage
from poil_drake.recording.run_log.recorded_run import Series
from poil_drake.systems.cameras.camera_ports import DeclareCameraOutputs

_ROUNDING = 1e-6


@dataclass(frozen=True, kw_only=True)
class RecordedCamera:
    """The recording of one camera.

    Attributes:
        name: The camera's name.
        shown_from: Time at which each image appeared [s], ascending.
        stamps: Capture time of each image [s].
        read: Returns the image with a given index.
        labels: Whether any of the images have labels.
        times: The recorded `image_time` [s] as a series (T, 1), which also covers images that the
            run did not record. None: `image_time` is the current time, as for a simulated camera
            without a delay.
    """

    name: str
    shown_from: Sequence[float]
    stamps: Sequence[float]
    read: Callable[[int], RgbdImage]
    labels: bool
    times: Series | None


class RecordedCameras(LeafSystem):
    """Shows the newest recorded image of each camera.

    .. pydrake_system::

        name: RecordedCameras
        output_ports:
        - <camera>.rgb_image
        - <camera>.depth_image
        - <camera>.rgbd_image
        - <camera>.label_image
        - <camera>.image_time

    The outputs are those of `CapturedCameras`, as functions of time. An image is decoded when a
    port is evaluated. When the run did not record an image, `image_time` changes, but the image
    ports keep the last recorded image.
    """

    def __init__(self, *, cameras: Sequence[RecordedCamera]):
        """Constructs the system.

        Args:
            cameras: The recordings, one for each camera.
        """
        super().__init__()
        for camera in cameras:
            self._declare_outputs(camera)

    def _declare_outputs(self, camera: RecordedCamera) -> None:
        def image(context: Context) -> RgbdImage | None:
            index = _shown(camera, context.get_time())
            return None if index < 0 else camera.read(index)

        DeclareCameraOutputs(
            self,
            camera.name,
            image=image,
            time=lambda context: _image_time(camera, context.get_time()),
            labels=camera.labels,
            prerequisites={self.time_ticket()},
        )


def _shown(camera: RecordedCamera, time: float) -> int:
    """Returns the index of the image shown at a time [s]; -1 before the first."""
    return bisect_right(camera.shown_from, time + _ROUNDING) - 1


def _image_time(camera: RecordedCamera, time: float) -> float:
    """Returns the value of `image_time` [s] at a time [s]."""
    if camera.times is None:
        return time
    index = _shown(camera, time)
    stamp = camera.stamps[index] if index >= 0 else np.nan
    # A recorded image was the newest one when it was used.
    return float(np.fmax(stamp, camera.times.at(time)[0]))
