"""What stands in a demonstration file, found in one pass without decoding the images."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.message import DecodeError
from mcap.records import Attachment, Metadata
from mcap.well_known import MessageEncoding

from poil_drake.errors import DemonstrationError, InvalidValueError
from poil_drake.recording.demonstration.frame_tree import FrameTree
from poil_drake.recording.demonstration.layout import (
    CAMERA_TOPIC,
    METADATA_RECORD,
    SCENARIO_ATTACHMENT,
)
from poil_drake.recording.mcap.camera_messages import (
    Calibration,
    decode_calibration,
    decode_transform,
)
from poil_drake.recording.mcap.scan import Location, ScannedMessage, scan
from poil_drake.recording.mcap.timestamps import get_timestamp

_IMAGES = (CompressedImage, RawImage)
_TRANSFORMS = (FrameTransform, FrameTransforms)
_WANTED: dict[str, tuple[type, ...]] = {
    "image": _IMAGES,
    "depth": _IMAGES,
    "label": _IMAGES,
    "calibration": (CameraCalibration,),
}


def _full_name(message_type: Any) -> str:
    return message_type.DESCRIPTOR.full_name


@dataclass(frozen=True)
class StoredImage:
    """An image that is still in the file.

    Attributes:
        stamp: When it was captured [ns].
        frame_id: The frame that the recorder gave it.
        message_type: Its Foxglove message class.
        location: Where it stands in the file.
    """

    stamp: int
    frame_id: str
    message_type: Any
    location: Location


@dataclass
class CameraContents:
    """What a file holds of one camera, in order of time once `collect` has returned."""

    image: list[StoredImage] = field(default_factory=list)
    depth: list[StoredImage] = field(default_factory=list)
    label: list[StoredImage] = field(default_factory=list)
    calibration: list[tuple[int, Calibration]] = field(default_factory=list)

    @property
    def frame_id(self) -> str:
        """The camera's optical frame: the calibration's, or else the image's."""
        return self.calibration[0][1].frame_id or self.image[0].frame_id


@dataclass
class Contents:
    """What a demonstration file holds."""

    cameras: dict[str, CameraContents] = field(default_factory=dict)
    frames: FrameTree = field(default_factory=FrameTree)
    metadata: dict[str, str] = field(default_factory=dict)
    scenario_text: str | None = None


def stamps(stored: list[StoredImage]) -> np.ndarray:
    """Returns the stamps of images [ns]."""
    return np.array([image.stamp for image in stored], dtype=np.int64)


def collect(path: Path) -> Contents:
    """Reads through a whole file; topics that do not belong to the layout are passed over.

    Raises:
        DemonstrationError: if the file is damaged, or a topic of the layout holds something else.
    """
    contents = Contents()
    for item in scan(path):
        if isinstance(item, Metadata):
            if item.name == METADATA_RECORD:
                contents.metadata |= item.metadata
        elif isinstance(item, Attachment):
            if item.name == SCENARIO_ATTACHMENT:
                contents.scenario_text = item.data.decode(errors="replace")
        else:
            try:
                _take(contents, item)
            except (DecodeError, InvalidValueError) as error:
                problem = getattr(error, "problem", f"a message is damaged: {error}.")
                raise DemonstrationError(
                    f"{path}, topic {item.topic}: {problem}",
                    remedy=getattr(error, "remedy", "Record the demonstration again."),
                ) from error
    for camera in contents.cameras.values():
        for stream in (camera.image, camera.depth, camera.label):
            stream.sort(key=lambda image: image.stamp)
        camera.calibration.sort(key=lambda entry: entry[0])
    return contents


def _take(contents: Contents, scanned: ScannedMessage) -> None:
    """Adds a message to what was found so far."""
    if message_type := _type_of(scanned, _TRANSFORMS):
        _take_transforms(contents.frames, message_type.FromString(scanned.data), scanned.log_time)
        return
    match = CAMERA_TOPIC.fullmatch(scanned.topic)
    if match is None:
        return
    kind = match["kind"]
    message_type = _type_of(scanned, _WANTED[kind])
    if message_type is None:
        if kind == "label":
            return
        wanted = " or ".join(_full_name(wanted) for wanted in _WANTED[kind])
        raise InvalidValueError(
            f"it holds '{scanned.schema}' messages encoded as '{scanned.encoding}', but {wanted} "
            "as protobuf is needed.",
            remedy="Convert the topic, see docs/demonstration_format.md.",
        )
    message = message_type.FromString(scanned.data)
    stamp = get_timestamp(message, default=scanned.log_time)
    camera = contents.cameras.setdefault(match["camera"], CameraContents())
    if kind == "calibration":
        camera.calibration.append((stamp, decode_calibration(message)))
    else:
        streams: Mapping[str, list[StoredImage]] = vars(camera)
        streams[kind].append(StoredImage(stamp, message.frame_id, message_type, scanned.location))


def _type_of(scanned: ScannedMessage, candidates: tuple[type, ...]) -> Any:
    """Returns which of the message classes a message is of, or None."""
    if scanned.encoding != MessageEncoding.Protobuf:
        return None
    return next((c for c in candidates if _full_name(c) == scanned.schema), None)


def _take_transforms(frames: FrameTree, message: Any, log_time: int) -> None:
    single = [message] if isinstance(message, FrameTransform) else message.transforms
    for transform in single:
        frames.add(
            parent=transform.parent_frame_id,
            child=transform.child_frame_id,
            stamp=get_timestamp(transform, default=log_time),
            X_PC=decode_transform(transform),
        )
