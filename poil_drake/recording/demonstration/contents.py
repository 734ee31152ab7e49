"""The contents of a demonstration file or run log, collected without decoding its images."""

import logging
from collections.abc import Iterator
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
    LIVE_KEY,
    SCENARIO_ATTACHMENT,
    STATIC_TRANSFORM_TOPIC,
)
from poil_drake.recording.demonstration.stored_images import StoredImage
from poil_drake.recording.mcap.message_decoders import (
    Calibration,
    decode_calibration,
)
from poil_drake.recording.mcap.scan import CutOffError, ScannedMessage, scan
from poil_drake.recording.mcap.sink import METADATA_RECORD
from poil_drake.recording.mcap.timestamps import get_timestamp


@dataclass
class CameraContents:
    """The messages of one camera in a file.

    Attributes:
        image: Its colour images.
        depth: Its depth images.
        label: Its label images.
        calibration: Pairs of a stamp [ns] and the intrinsics that hold from then on.
        depth_calibration: The same for depth images that are not registered to colour.
    """

    image: list[StoredImage] = field(default_factory=list)
    depth: list[StoredImage] = field(default_factory=list)
    label: list[StoredImage] = field(default_factory=list)
    calibration: list[tuple[int, Calibration]] = field(default_factory=list)
    depth_calibration: list[tuple[int, Calibration]] = field(default_factory=list)

    @property
    def frame_id(self) -> str:
        """The name of the optical frame: the calibration's, or else the first image's."""
        return self.calibration[0][1].frame_id or self.image[0].frame_id

    @property
    def depth_frame_id(self) -> str:
        """The name of the depth images' optical frame: `frame_id` if they are registered to it."""
        if not self.depth_calibration:
            return self.frame_id
        return self.depth_calibration[0][1].frame_id or self.depth[0].frame_id


@dataclass
class Contents:
    """The contents of a demonstration file, or of a run log, which shares its layout."""

    cameras: dict[str, CameraContents] = field(default_factory=dict)
    frames: FrameTree = field(default_factory=FrameTree)
    metadata: dict[str, str] = field(default_factory=dict)
    scenario_text: str | None = None

    def add(self, item: ScannedMessage | Metadata | Attachment) -> None:
        """Adds an item that was read from a file; ignores items that are not part of the layout.

        Raises:
            InvalidValueError: if a message is damaged, or has the wrong type for its topic.
        """
        if isinstance(item, ScannedMessage):
            self._add_message(item)
        elif isinstance(item, Metadata) and item.name == METADATA_RECORD:
            self.metadata |= item.metadata
        elif isinstance(item, Attachment) and item.name == SCENARIO_ATTACHMENT:
            self.scenario_text = item.data.decode(errors="replace")

    def _add_message(self, scanned: ScannedMessage) -> None:
        if scanned.message_type(FrameTransform, FrameTransforms):
            message = scanned.decode(FrameTransform, FrameTransforms)
            for transform in getattr(message, "transforms", [message]):
                self.frames.add(
                    transform,
                    log_time=scanned.log_time,
                    static=scanned.topic == STATIC_TRANSFORM_TOPIC,
                )
            return
        match = CAMERA_TOPIC.fullmatch(scanned.topic)
        if match is None:
            return
        kind = match["kind"]
        if kind == "label" and not scanned.message_type(CompressedImage, RawImage):
            return
        camera = self.cameras.setdefault(match["camera"], CameraContents())
        if kind.endswith("calibration"):
            message = scanned.decode(CameraCalibration)
            stamp = get_timestamp(message, default=scanned.log_time)
            getattr(camera, kind).append((stamp, decode_calibration(message)))
        else:
            getattr(camera, kind).append(StoredImage.of(scanned))


def collect(path: Path) -> Contents:
    """Reads a whole file and returns its contents, with each stream in the order of the file.

    A live recording may be cut off. A warning is then logged.

    Raises:
        DemonstrationError: if the file or a message is damaged, or a topic has the wrong type.
    """
    contents = Contents()
    for item in _scan(path, contents):
        try:
            contents.add(item)
        except InvalidValueError as error:
            where = f"{path}, topic {item.topic}" if isinstance(item, ScannedMessage) else path
            raise DemonstrationError(f"{where}: {error.problem}", remedy=error.remedy) from error
    for camera in contents.cameras.values():
        camera.calibration.sort(key=lambda entry: entry[0])
        camera.depth_calibration.sort(key=lambda entry: entry[0])
    return contents


def _scan(path: Path, contents: Contents) -> Iterator[ScannedMessage | Metadata | Attachment]:
    """Scans a file; `contents` holds what was found before. Live recordings may be cut off."""
    try:
        yield from scan(path)
    except CutOffError:
        if LIVE_KEY not in contents.metadata:
            raise
        logging.getLogger(__name__).warning(
            "%s is cut off: its recorder was killed, or the disk was full. All complete images "
            "are loaded, but the end of the motion may be missing.",
            path,
        )
