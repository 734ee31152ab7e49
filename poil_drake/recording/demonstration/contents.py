"""The contents of a demonstration file, found in one pass without decoding the images."""

from dataclasses import dataclass, field
from pathlib import Path

from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from mcap.records import Attachment, Metadata

from poil_drake.errors import DemonstrationError, InvalidValueError
from poil_drake.recording.demonstration.frame_tree import FrameTree
from poil_drake.recording.demonstration.layout import (
    CAMERA_TOPIC,
    METADATA_RECORD,
    SCENARIO_ATTACHMENT,
)
from poil_drake.recording.demonstration.stored_images import StoredImage
from poil_drake.recording.mcap.camera_messages import (
    Calibration,
    decode_calibration,
    decode_transform,
)
from poil_drake.recording.mcap.scan import ScannedMessage, scan
from poil_drake.recording.mcap.timestamps import get_timestamp


@dataclass
class CameraContents:
    """What a file holds of one camera; `collect` returns it in order of time.

    Attributes:
        image: Its colour images.
        depth: Its depth images.
        label: Its label images.
        calibration: Its intrinsics and since when they hold [ns].
    """

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


def collect(path: Path) -> Contents:
    """Reads through a whole file; topics that do not belong to the layout are ignored.

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
                _add(contents, item)
            except InvalidValueError as error:
                raise DemonstrationError(
                    f"{path}, topic {item.topic}: {error.problem}", remedy=error.remedy
                ) from error
    for camera in contents.cameras.values():
        for stream in (camera.image, camera.depth, camera.label):
            stream.sort(key=lambda image: image.stamp)
        camera.calibration.sort(key=lambda entry: entry[0])
    return contents


def _add(contents: Contents, scanned: ScannedMessage) -> None:
    """Adds a message of the layout to the contents."""
    if scanned.message_type(FrameTransform, FrameTransforms):
        message = scanned.decode(FrameTransform, FrameTransforms)
        for transform in getattr(message, "transforms", [message]):
            contents.frames.add(
                parent=transform.parent_frame_id,
                child=transform.child_frame_id,
                stamp=get_timestamp(transform, default=scanned.log_time),
                X_PC=decode_transform(transform),
            )
        return
    match = CAMERA_TOPIC.fullmatch(scanned.topic)
    if match is None:
        return
    kind = match["kind"]
    if kind == "label" and not scanned.message_type(CompressedImage, RawImage):
        return
    camera = contents.cameras.setdefault(match["camera"], CameraContents())
    if kind == "calibration":
        message = scanned.decode(CameraCalibration)
        stamp = get_timestamp(message, default=scanned.log_time)
        camera.calibration.append((stamp, decode_calibration(message)))
    else:
        getattr(camera, kind).append(StoredImage.of(scanned))
