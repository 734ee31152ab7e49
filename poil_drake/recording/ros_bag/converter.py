"""Converts the messages of a ROS bag to those of a demonstration, and writes them."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration

from poil_drake.errors import DemonstrationError
from poil_drake.recording.demonstration.frame_tree import FrameTree
from poil_drake.recording.demonstration.layout import (
    STATIC_TRANSFORM_TOPIC,
    TRANSFORM_TOPIC,
    camera_topic,
    optical_frame,
)
from poil_drake.recording.mcap.library_versions import version_metadata
from poil_drake.recording.mcap.message_decoders import decode_transform, frame_name
from poil_drake.recording.mcap.message_encoder import EncodedMessage, MessageEncoder
from poil_drake.recording.mcap.sink import McapSink
from poil_drake.recording.mcap.timestamps import get_timestamp
from poil_drake.recording.ros_bag.bag import CAMERA_INFO, TRANSFORMS, BagMessage, RosBag
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
        self._frames: dict[str, str] = {}  # In the bag, by topic of the calibration.
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
        elif message.type == CAMERA_INFO:
            self._add_calibration(message)
        else:
            self._write(self._own[message.topic], convert_image(message.content))

    def require_pose(self, bag: RosBag, name: str, world: str) -> None:
        """Raises a DemonstrationError unless the transforms give the pose of a camera."""
        own = camera_topic(name, "calibration")
        frame = self._frames[own]
        if not self._tree.connected(base=world, frame=frame):
            raise DemonstrationError(
                f"{bag.path}: no transform connects frame '{world}' with frame '{frame}' of camera "
                f"'{name}'. The frames in the bag: {self._tree.listing()}.",
                remedy="Name the frame that is the scenario's world with --world; or record "
                "/tf_static, too; or take the poses from a scenario's cameras with --scenario.",
            )
        users = [topic for topic, other in self._frames.items() if other == frame]
        if len(users) > 1 and not all(topic.startswith(f"/camera/{name}/") for topic in users):
            raise DemonstrationError(
                f"{bag.path}: several cameras have the same frame, '{frame}': {', '.join(users)}.",
                remedy="Give each camera's driver another name and record again, or take the poses "
                "from a scenario's cameras with --scenario.",
            )

    def add_pose(self, name: str, world: str, X_WC: np.ndarray) -> None:
        """Writes the pose of a camera, and of its depth images if they have a calibration.

        Raises:
            InvalidValueError: if no transform connects colour and depth.
        """
        color, depth = (camera_topic(name, kind) for kind in ("calibration", "depth_calibration"))
        self._write_pose(world, _own_frame(color), X_WC)
        if depth in self._frames:
            X_CD = self._tree.pose(
                base=self._frames[color], frame=self._frames[depth], stamp=self._log_time
            )
            self._write_pose(_own_frame(color), _own_frame(depth), X_CD)

    def finish(self, metadata: Mapping[str, str]) -> None:
        """Writes the metadata and closes the file."""
        self._sink.add_metadata({**version_metadata(), **metadata})
        self._sink.close()

    def _add_transforms(self, message: BagMessage) -> None:
        static = message.topic.endswith(STATIC_TRANSFORM_TOPIC)
        for stamped in message.content.transforms:
            transform = convert_transform(stamped)
            self._tree.add(
                parent=frame_name(transform.parent_frame_id),
                child=frame_name(transform.child_frame_id),
                stamp=get_timestamp(transform, default=0),
                log_time=message.log_time,
                X_PC=decode_transform(transform),
                static=static,
            )
            if not self._posed:
                self._write(STATIC_TRANSFORM_TOPIC if static else TRANSFORM_TOPIC, transform)

    def _add_calibration(self, message: BagMessage) -> None:
        """Writes a calibration, unless it is the same as the last one."""
        own = self._own[message.topic]
        _, _, name, kind = own.split("/")
        image = camera_topic(name, "image" if kind == "calibration" else "depth")
        # image_proc and the drivers call rectified images e.g. image_rect_color.
        rectified = "rect" in image_name(self._chosen[image]).rpartition("/")[2]
        calibration = convert_calibration(message.content, rectified=rectified)
        self._frames[own] = frame_name(calibration.frame_id)
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
