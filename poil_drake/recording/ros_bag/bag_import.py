"""Imports a ROS bag as a demonstration."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration

from poil_drake.errors import DemonstrationError, InvalidValueError
from poil_drake.recording.demonstration.demonstration import load_demonstration
from poil_drake.recording.demonstration.frame_tree import FrameTree
from poil_drake.recording.demonstration.layout import (
    CAMERAS_KEY,
    LABEL_IDS_KEY,
    STATIC_TRANSFORM_TOPIC,
    TRANSFORM_TOPIC,
    WORLD_FRAME,
    WORLD_FRAME_KEY,
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
from poil_drake.recording.ros_bag.topic_choice import choose_topics, image_name
from poil_drake.runtime.output_files import whole_file


class ImportedBag(NamedTuple):
    """What an import wrote.

    Attributes:
        topics: The bag's topic for each topic of the demonstration.
        frames: The number of frames in which all cameras have colour and depth.
        duration: The time from the first to the last frame [s].
    """

    topics: dict[str, str]
    frames: int
    duration: float


def import_ros_bag(
    path: str | Path,
    output: str | Path,
    *,
    cameras: Mapping[str, str],
    topics: Mapping[str, str] | None = None,
    label_ids: Mapping[str, Sequence[int]] | None = None,
    world: str = WORLD_FRAME,
    poses: Mapping[str, np.ndarray] | None = None,
) -> ImportedBag:
    """Writes what cameras recorded in a ROS bag as a demonstration, and checks that it loads.

    Images keep their encoding. All messages keep their stamps and the times of logging.

    Args:
        path: The bag; see `RosBag`.
        output: The demonstration (MCAP).
        cameras: The prefix of each camera's topics, by the name of the camera.
        topics: Topics that are not guessed; see `choose_topics`.
        label_ids: The labels of each object and part in label images, e.g. {"mug/handle": [4]}.
        world: The frame in the bag that is the world of the scenario.
        poses: The (4, 4) pose of each camera in the world [m]. None: the bag's transforms.

    Raises:
        DemonstrationError: if the bag is damaged, lacks something, or makes no valid demonstration.
    """
    world = frame_name(world)
    with RosBag(path) as bag, whole_file(Path(output)) as stream:
        chosen = choose_topics(bag, cameras, topics or {})
        writer = _Writer(McapSink(stream), chosen, posed=poses is not None)
        transforms = [name for name, topic in bag.topics.items() if topic.type == TRANSFORMS]
        for message in bag.messages([*chosen.values(), *transforms]):
            with _named(f"{bag.path}, topic {message.topic}"):
                writer.add(message)
        for name in cameras:
            if poses is None:
                writer.require_pose(bag, name, world)
            else:
                with _named(f"{bag.path}, camera '{name}'"):
                    writer.add_pose(name, world, poses[name])
        writer.finish(
            {
                CAMERAS_KEY: json.dumps(list(cameras)),
                LABEL_IDS_KEY: json.dumps({k: list(ids) for k, ids in (label_ids or {}).items()}),
                WORLD_FRAME_KEY: world,
                "ros_bag": bag.path.name,
                "ros_topics": json.dumps(chosen),
            }
        )
        try:
            demonstration = load_demonstration(stream.name)
        except DemonstrationError as error:
            sources = ", ".join(f"{own} is {topic}" for own, topic in chosen.items())
            raise DemonstrationError(
                f"{error.problem.replace(stream.name, str(bag.path))} In the bag, {sources}.",
                remedy=error.remedy,
            ) from error
    return ImportedBag(chosen, len(demonstration.frames), demonstration.duration)


class _Writer:
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
        image = own.replace("depth_calibration", "depth").replace("calibration", "image")
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


@contextmanager
def _named(source: str) -> Iterator[None]:
    """Turns an InvalidValueError into a DemonstrationError that names its source."""
    try:
        yield
    except InvalidValueError as error:
        raise DemonstrationError(f"{source}: {error.problem}", remedy=error.remedy) from error
