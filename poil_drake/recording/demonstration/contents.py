"""The contents of a demonstration file or run log, collected without decoding its images."""

import bisect
import logging
from collections.abc import Iterator
from dataclasses import dataclass, field
from operator import itemgetter
from pathlib import Path

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from mcap.records import Attachment, Metadata

from poil_drake.errors import DemonstrationError, InvalidValueError
from poil_drake.recording.demonstration.layout import CAMERA_TOPIC, LIVE_KEY, SCENARIO_ATTACHMENT
from poil_drake.recording.demonstration.stored_images import StoredImage
from poil_drake.recording.mcap.message_decoders import (
    Calibration,
    decode_calibration,
    decode_transform,
    frame_name,
)
from poil_drake.recording.mcap.scan import CutOffError, ScannedMessage, scan
from poil_drake.recording.mcap.sink import METADATA_RECORD
from poil_drake.recording.mcap.timestamps import get_timestamp

_STAMP = itemgetter(0)


class FrameTree:
    """Frames and the recorded transforms between them.

    A transform holds from its stamp until the stamp of the next transform between the same frames.
    The first one also holds before its stamp, so that a static transform may carry any stamp.
    """

    def __init__(self) -> None:
        self._parent: dict[str, str] = {}
        self._poses: dict[str, list[tuple[int, np.ndarray]]] = {}

    def add(self, *, parent: str, child: str, stamp: int, X_PC: np.ndarray) -> None:
        """Adds the (4, 4) pose of `child` in `parent` [m] at `stamp` [ns].

        If `child` had another parent, its poses in that parent are discarded.
        """
        if self._parent.get(child) != parent:
            self._parent[child], self._poses[child] = parent, []
        bisect.insort(self._poses[child], (stamp, X_PC), key=_STAMP)

    def __contains__(self, frame: str) -> bool:
        return frame in self._parent or frame in self._parent.values()

    def root(self, frame: str) -> str:
        """Returns the root of the tree that holds `frame`, which may be `frame` itself."""
        return self._chain(frame)[-1]

    def pose(self, *, base: str, frame: str, stamp: int) -> np.ndarray | None:
        """Returns the (4, 4) pose of `frame` in `base` [m] at `stamp` [ns]; None if unconnected."""
        if self.root(base) != self.root(frame):
            return None
        X_RB = self._pose_in_root(base, stamp)
        return np.linalg.solve(X_RB, self._pose_in_root(frame, stamp))

    def _chain(self, frame: str) -> list[str]:
        """Returns `frame` and its ancestors, each once even if the transforms form a cycle."""
        chain = [frame]
        while (parent := self._parent.get(chain[-1])) is not None and parent not in chain:
            chain.append(parent)
        return chain

    def _pose_in_root(self, frame: str, stamp: int) -> np.ndarray:
        X_RF = np.eye(4)
        for child in self._chain(frame)[:-1]:
            poses = self._poses[child]
            at = bisect.bisect_right(poses, stamp, key=_STAMP) - 1
            X_RF = poses[max(at, 0)][1] @ X_RF
        return X_RF


@dataclass
class CameraContents:
    """The messages of one camera in a file.

    Attributes:
        image: Its colour images.
        depth: Its depth images.
        label: Its label images.
        calibration: Pairs of a stamp [ns] and the intrinsics that hold from then on.
    """

    image: list[StoredImage] = field(default_factory=list)
    depth: list[StoredImage] = field(default_factory=list)
    label: list[StoredImage] = field(default_factory=list)
    calibration: list[tuple[int, Calibration]] = field(default_factory=list)

    @property
    def frame_id(self) -> str:
        """The name of the optical frame: the calibration's, or else the first image's."""
        return self.calibration[0][1].frame_id or self.image[0].frame_id


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
                    parent=frame_name(transform.parent_frame_id),
                    child=frame_name(transform.child_frame_id),
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
        camera = self.cameras.setdefault(match["camera"], CameraContents())
        if kind == "calibration":
            message = scanned.decode(CameraCalibration)
            stamp = get_timestamp(message, default=scanned.log_time)
            camera.calibration.append((stamp, decode_calibration(message)))
        else:
            getattr(camera, kind).append(StoredImage.of(scanned))


def collect(path: Path) -> Contents:
    """Reads a whole file and returns its contents, with each camera's messages sorted by stamp.

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
        for stream in (camera.image, camera.depth, camera.label):
            stream.sort(key=lambda image: image.stamp)
        camera.calibration.sort(key=lambda entry: entry[0])
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
