"""Converts the messages of a ROS bag to those of a demonstration, and writes them."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration

from poil_drake.recording.demonstration.frame_tree import FrameTree
from poil_drake.recording.demonstration.layout import (
    STATIC_TRANSFORM_TOPIC,
    TRANSFORM_TOPIC,
    camera_topic,
    optical_frame,
)
from poil_drake.recording.mcap.library_versions import version_metadata
from poil_drake.recording.mcap.message_decoders import frame_name
from poil_drake.recording.mcap.message_encoder import EncodedMessage, MessageEncoder
from poil_drake.recording.mcap.sink import McapSink
from poil_drake.recording.ros_bag.bag import CAMERA_INFO, TRANSFORMS, BagMessage
from poil_drake.recording.ros_bag.messages import (
    convert_calibration,
    convert_image,
    convert_transform,
)
from poil_drake.recording.ros_bag.topic_choice import image_name


class BagConverter:
    """Converts the messages of a bag and writes them.

    Args:
        sink: Where to write.
        chosen: The bag's topic for each topic of the demonstration.
        posed: Whether the cameras' poses are given; then the transforms are not written.
    """

    def __init__(self, sink: McapSink, chosen: Mapping[str, str], *, posed: bool):
        self._sink, self._chosen, self._posed = sink, chosen, posed
        self._own = {topic: own for own, topic in chosen.items()}
        self._calibrations: dict[str, CameraCalibration] = {}
        self._frames: dict[str, str] = {}  # In the bag, by topic of the demonstration.
        self._tree = FrameTree()
        self._log_time = 0

    def add(self, message: BagMessage) -> None:
        """Writes a message.

        Raises:
            InvalidValueError: if it cannot be converted.
        """
        self._log_time = message.log_time
        if message.type == TRANSFORMS:
            self._add_transforms(message)
            return
        own = self._own[message.topic]
        self._frames.setdefault(own, frame_name(message.content.header.frame_id))
        if message.type == CAMERA_INFO:
            self._add_calibration(own, message)
        else:
            self._write(own, convert_image(message.content))

    def add_pose(self, name: str, world: str, X_WC: np.ndarray) -> None:
        """Writes the pose of a camera, and of its depth images if they have a calibration.

        Raises:
            InvalidValueError: if no transform connects colour and depth.
        """
        color, depth = (camera_topic(name, kind) for kind in ("calibration", "depth_calibration"))
        self._write_pose(world, _own_frame(color), X_WC)
        if depth in self._frames:
            frame, depth_frame = (
                self._frames.get(calibration) or self._frames.get(camera_topic(name, kind), "")
                for calibration, kind in ((color, "image"), (depth, "depth"))
            )
            X_CD = self._tree.pose(base=frame, frame=depth_frame, stamp=self._log_time)
            self._write_pose(_own_frame(color), _own_frame(depth), X_CD)

    def finish(self, metadata: Mapping[str, str]) -> None:
        """Writes the metadata and closes the file."""
        self._sink.add_metadata({**version_metadata(), **metadata})
        self._sink.close()

    def _add_transforms(self, message: BagMessage) -> None:
        static = message.topic.endswith(STATIC_TRANSFORM_TOPIC)
        for stamped in message.content.transforms:
            transform = convert_transform(stamped)
            self._tree.add(transform, log_time=message.log_time, static=static)
            if not self._posed:
                self._write(STATIC_TRANSFORM_TOPIC if static else TRANSFORM_TOPIC, transform)

    def _add_calibration(self, own: str, message: BagMessage) -> None:
        """Writes a calibration, unless it is the same as the last one."""
        _, _, name, kind = own.split("/")
        image = camera_topic(name, "image" if kind == "calibration" else "depth")
        # image_proc and the drivers call rectified images e.g. image_rect_color.
        rectified = "rect" in image_name(self._chosen[image]).rpartition("/")[2]
        calibration = convert_calibration(message.content, rectified=rectified)
        if self._posed:  # In the bag, the frames of two cameras may have one name.
            calibration.frame_id = _own_frame(own)
        last = self._calibrations.get(own)
        if last is not None:
            last.timestamp.CopyFrom(calibration.timestamp)
        if calibration != last:
            self._calibrations[own] = calibration
            self._write(own, calibration)

    def _write(self, own: str, message: Any) -> None:
        encoded = EncodedMessage(type(message), message.SerializeToString())
        self._sink.write(own, encoded, time=self._log_time)

    def _write_pose(self, parent: str, child: str, X_PC: np.ndarray) -> None:
        stamp = self._log_time
        pose = MessageEncoder().transform(X_PC, parent=parent, child=child, stamp=stamp)
        self._sink.write(STATIC_TRANSFORM_TOPIC, pose, time=stamp)


def _own_frame(calibration: str) -> str:
    """Returns the frame of a topic of calibrations whose camera's pose is given."""
    _, _, name, kind = calibration.split("/")
    return optical_frame(name if kind == "calibration" else f"{name}_depth")
