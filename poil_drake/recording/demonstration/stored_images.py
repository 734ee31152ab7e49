"""Images that stay in their MCAP file until they are needed."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.message import DecodeError

from poil_drake.errors import DemonstrationError, InvalidValueError
from poil_drake.perception.images import RgbdImage
from poil_drake.recording.demonstration.layout import camera_topic
from poil_drake.recording.demonstration.rectification import rectify
from poil_drake.recording.mcap.image_messages import decode_color, decode_depth, decode_label
from poil_drake.recording.mcap.message_decoders import Calibration
from poil_drake.recording.mcap.scan import Location, ScannedMessage, read_messages
from poil_drake.recording.mcap.timestamps import get_timestamp, to_seconds

_DECODERS = {"image": decode_color, "depth": decode_depth, "label": decode_label}


@dataclass(frozen=True)
class StoredImage:
    """The location and metadata of an image that is still in the file.

    Attributes:
        stamp: When it was captured [ns].
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
        stamp = get_timestamp(message, default=scanned.log_time)
        return cls(stamp, scanned.log_time, message.frame_id, type(message), scanned.location)


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
        self,
        path: Path,
        camera: str,
        *,
        size: tuple[int, int],
        size_source: str,
        lens: Calibration | None = None,
    ) -> RgbdImage:
        """Returns the decoded images.

        Args:
            path: The file.
            camera: The camera's name.
            size: Width and height that every image must have [px].
            size_source: The words before `size` in errors, e.g. "the camera is calibrated for".
            lens: The calibration whose distortion is removed; None for rectified images.

        Raises:
            DemonstrationError: if an image cannot be decoded or has another size, or the file has
                changed. The message names the file and, for an image, the topic.
        """
        stored = {"image": self.color, "depth": self.depth}
        stored |= {} if self.label is None else {"label": self.label}
        data = read_messages(path, [image.location for image in stored.values()])
        pixels = {}
        for (kind, image), content in zip(stored.items(), data, strict=True):
            try:
                decoded = _DECODERS[kind](image.message_type.FromString(content))
                height, width = decoded.shape[:2]
                if (width, height) != size:
                    raise InvalidValueError(
                        f"an image has {width} x {height} pixels, but {size_source} {size[0]} x "
                        f"{size[1]}.",
                        remedy="Record colour and depth registered to each other, at the size of "
                        "the calibration.",
                    )
            except (DecodeError, InvalidValueError) as error:
                problem = getattr(error, "problem", f"a message is damaged: {error}.")
                raise DemonstrationError(
                    f"{path}, topic {camera_topic(camera, kind)}, at {to_seconds(image.stamp)} s: "
                    f"{problem}",
                    remedy=getattr(error, "remedy", "Record the demonstration again."),
                ) from error
            pixels[kind] = rectify(decoded, lens, interpolate=kind == "image") if lens else decoded
        return RgbdImage(
            rgb=pixels["image"],
            depth=pixels["depth"],
            stamp=to_seconds(self.color.stamp),
            label=pixels.get("label"),
        )
