"""Images and frames that stay in their MCAP file until they are needed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, Self

import cv2
import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.message import DecodeError

from poil_drake.errors import DemonstrationError, InvalidValueError
from poil_drake.geometry.depth_image import register_depth
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage
from poil_drake.recording.demonstration.layout import camera_topic
from poil_drake.recording.mcap.message_decoders import (
    Calibration,
    decode_color,
    decode_depth,
    decode_label,
    frame_name,
)
from poil_drake.recording.mcap.scan import Location, ScannedMessage, read_messages
from poil_drake.recording.mcap.timestamps import get_timestamp, to_seconds

_DECODERS = {"image": decode_color, "depth": decode_depth, "label": decode_label}

# A 640 x 480 frame of two cameras takes 4 MB; a tracker needs a frame and its predecessor.
_CACHED_FRAMES = 4


@dataclass(frozen=True)
class StoredImage:
    """The location and metadata of an image that is still in the file.

    Attributes:
        stamp: When it was captured [ns]; 0 if this is not filled in.
        log_time: When it was logged [ns].
        frame_id: The frame in which it was recorded.
        message_type: Its Foxglove message class.
        location: Where it is in the file.
    """

    stamp: int
    log_time: int
    frame_id: str
    message_type: Any
    location: Location

    @classmethod
    def of(cls, scanned: ScannedMessage) -> Self:
        """Returns the location and metadata of the image in a message.

        Raises:
            InvalidValueError: if the message is damaged or is not an image.
        """
        message = scanned.decode(CompressedImage, RawImage)
        stamp = get_timestamp(message, default=0)
        frame = frame_name(message.frame_id)
        return cls(stamp, scanned.log_time, frame, type(message), scanned.location)


class Registration(NamedTuple):
    """How the depth images of a camera are registered to its colour images.

    Attributes:
        lens: The calibration of the depth images.
        X_CD: (4, 4) pose of the depth images' optical frame in that of the colour images [m].
    """

    lens: Calibration
    X_CD: np.ndarray


@dataclass(frozen=True)
class StoredImages:
    """The images of one camera at one instant, not yet decoded.

    Attributes:
        color: The colour image.
        depth: The depth image.
        label: The label image, which may have been logged later; None if there is none.
    """

    color: StoredImage
    depth: StoredImage
    label: StoredImage | None = None

    @property
    def time(self) -> float:
        """When the colour image was logged [s]."""
        return to_seconds(self.color.log_time)

    def read(
        self, path: Path, camera: str, lens: Calibration, registration: Registration | None = None
    ) -> RgbdImage:
        """Returns the decoded images, rectified and with depth registered to colour.

        Args:
            path: The file.
            camera: The camera's name.
            lens: The camera's calibration, which has the size of its images.
            registration: How depth is registered to colour; None if it is.

        Raises:
            DemonstrationError: if an image cannot be decoded or has another size, or the file has
                changed. The message names the file and, for an image, the topic.
        """
        stored = {"image": self.color, "depth": self.depth}
        stored |= {} if self.label is None else {"label": self.label}
        data = read_messages(path, [image.location for image in stored.values()])
        pixels = {}
        for (kind, image), content in zip(stored.items(), data, strict=True):
            own = registration.lens if registration and kind == "depth" else lens
            try:
                decoded = _DECODERS[kind](image.message_type.FromString(content))
                height, width = decoded.shape[:2]
                if (width, height) != (own.width, own.height):
                    raise InvalidValueError(
                        f"an image has {width} x {height} pixels instead of {own.width} x "
                        f"{own.height}.",
                        remedy="Record all images at the size of the calibration. If depth is not "
                        "registered to colour, also record its own calibration on "
                        f"{camera_topic(camera, 'depth_calibration')}.",
                    )
            except (DecodeError, InvalidValueError) as error:
                problem = getattr(error, "problem", f"a message is damaged: {error}.")
                raise DemonstrationError(
                    f"{path}, topic {camera_topic(camera, kind)}, at {to_seconds(image.stamp)} s: "
                    f"{problem}",
                    remedy=getattr(error, "remedy", "Record the demonstration again."),
                ) from error
            pixels[kind] = _rectify(decoded, own, interpolate=kind == "image")
        if registration is not None:
            pixels["depth"] = register_depth(
                pixels["depth"],
                registration.lens.K,
                lens.K,
                X_CD=registration.X_CD,
                size=(lens.height, lens.width),
            )
        return RgbdImage(
            rgb=pixels["image"],
            depth=pixels["depth"],
            stamp=to_seconds(self.color.stamp),
            label=pixels.get("label"),
        )


@dataclass(frozen=True, eq=False)
class StoredView:
    """What one camera saw at one instant, not yet decoded.

    Attributes:
        name: The camera's name.
        calibration: Its intrinsics.
        X_WC: (4, 4) pose of the camera in the world [m].
        images: Its images.
        registration: How its depth is registered to colour; None if it is.
    """

    name: str
    calibration: Calibration
    X_WC: np.ndarray
    images: StoredImages
    registration: Registration | None = None


class RecordedFrames(Sequence[MultiViewFrame]):
    """A sequence of frames, each decoded from the file when it is accessed.

    The last few frames are cached. Accessing a frame whose images cannot be decoded raises a
    DemonstrationError that names the file and the topic.

    Args:
        path: The file.
        instants: The views of each instant, in chronological order.
        label_ids: See `MultiViewFrame.label_ids`.
    """

    def __init__(
        self,
        path: Path,
        instants: Sequence[tuple[StoredView, ...]],
        label_ids: Mapping[str, tuple[int, ...]],
    ):
        self._path = path
        self._instants = tuple(instants)
        self._label_ids = dict(label_ids)
        self._frame = lru_cache(_CACHED_FRAMES)(self._decode)

    @property
    def stamps(self) -> np.ndarray:
        """The (T,) stamps of the frames [s]; reading them decodes no images."""
        return np.array(
            [min(to_seconds(view.images.color.stamp) for view in views) for views in self._instants]
        )

    @property
    def labelled(self) -> bool:
        """Whether any view has a label image; reading this decodes no images."""
        return any(view.images.label is not None for views in self._instants for view in views)

    def __len__(self) -> int:
        return len(self._instants)

    def __getitem__(self, index: int | slice) -> Any:
        """Returns one frame, or a slice as `RecordedFrames`."""
        if isinstance(index, slice):
            return RecordedFrames(self._path, self._instants[index], self._label_ids)
        return self._frame(range(len(self))[index])

    def _decode(self, index: int) -> MultiViewFrame:
        views = self._instants[index]
        # Images first, because decoding them checks the size in the calibration.
        images = tuple(
            v.images.read(self._path, v.name, v.calibration, v.registration) for v in views
        )
        cameras = tuple(
            CameraModel(v.name, v.calibration.width, v.calibration.height, v.calibration.K, v.X_WC)
            for v in views
        )
        labelled = any(view.images.label is not None for view in views)
        return MultiViewFrame(cameras, images, self._label_ids if labelled else {})


def _rectify(image: np.ndarray, calibration: Calibration, *, interpolate: bool) -> np.ndarray:
    """Returns the image that a pinhole camera with the same K would take.

    Args:
        image: (H, W) or (H, W, 3).
        calibration: The camera's calibration. Without distortion, the image is returned unchanged.
        interpolate: Use True for colour. False takes the nearest pixel, so that depth and labels
            are not mixed across edges.

    Returns:
        An image of the same shape; 0 outside the field of view of the lens.
    """
    if calibration.distortion.size == 0:
        return image
    map_u, map_v = _maps(calibration)
    return cv2.remap(
        image,
        map_u,
        map_v,
        cv2.INTER_LINEAR if interpolate else cv2.INTER_NEAREST,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=0,
    )


@lru_cache(maxsize=8)
def _maps(calibration: Calibration) -> tuple[np.ndarray, np.ndarray]:
    """Returns (H, W) u and v: where each rectified pixel is in the distorted image [px]."""
    K, size = calibration.K, (calibration.width, calibration.height)
    return cv2.initUndistortRectifyMap(K, calibration.distortion, None, K, size, cv2.CV_32FC1)
