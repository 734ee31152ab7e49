"""Imports a ROS bag as a demonstration."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from poil_drake.errors import DemonstrationError, InvalidValueError
from poil_drake.recording.demonstration.demonstration import load_demonstration
from poil_drake.recording.demonstration.layout import (
    CAMERAS_KEY,
    LABEL_IDS_KEY,
    TRANSFORM_TOPIC,
    WORLD_FRAME,
    WORLD_FRAME_KEY,
    camera_topic,
    optical_frame,
)
from poil_drake.recording.mcap.library_versions import version_metadata
from poil_drake.recording.mcap.message_decoders import frame_name
from poil_drake.recording.mcap.message_encoder import EncodedMessage, MessageEncoder
from poil_drake.recording.mcap.sink import McapSink
from poil_drake.recording.mcap.timestamps import get_timestamp
from poil_drake.recording.ros_bag.bag import CAMERA_INFO, TRANSFORMS, BagMessage, RosBag
from poil_drake.recording.ros_bag.frame_links import FrameLinks
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
        writer = _Writer(McapSink(stream), chosen, world=world, poses=poses)
        transforms = [name for name, topic in bag.topics.items() if topic.type == TRANSFORMS]
        for message in bag.messages([*chosen.values(), *(transforms if poses is None else [])]):
            try:
                writer.add(message)
            except InvalidValueError as error:
                raise DemonstrationError(
                    f"{bag.path}, topic {message.topic}: {error.problem}", remedy=error.remedy
                ) from error
        writer.links.require_connected(writer.frames, world=world, source=str(bag.path))
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

    Attributes:
        links: The transforms that were written.
        frames: The optical frame of each camera, by its name.
    """

    def __init__(
        self,
        sink: McapSink,
        chosen: Mapping[str, str],
        *,
        world: str,
        poses: Mapping[str, np.ndarray] | None,
    ):
        self._sink, self._chosen, self._world, self._poses = sink, chosen, world, poses
        self._own = {topic: own for own, topic in chosen.items()}
        self._encoder, self._calibrations = MessageEncoder(), dict[str, tuple]()
        self.links, self.frames = FrameLinks(), dict[str, str]()

    def add(self, message: BagMessage) -> None:
        """Writes a message.

        Raises:
            InvalidValueError: if it cannot be converted.
        """
        if message.type == TRANSFORMS:
            for stamped in message.content.transforms:
                transform = convert_transform(stamped)
                parent, child = transform.parent_frame_id, transform.child_frame_id
                self.links.add(parent=frame_name(parent), child=frame_name(child))
                self._write(TRANSFORM_TOPIC, transform, message.log_time)
        elif message.type == CAMERA_INFO:
            self._add_calibration(message)
        else:
            self._write(self._own[message.topic], convert_image(message.content), message.log_time)

    def finish(self, metadata: Mapping[str, str]) -> None:
        """Writes the metadata and closes the file."""
        self._sink.add_metadata({**version_metadata(), **metadata})
        self._sink.close()

    def _add_calibration(self, message: BagMessage) -> None:
        """Writes a calibration, and the camera's pose if that is given, unless it is unchanged."""
        own = self._own[message.topic]
        name = own.split("/")[2]
        image = image_name(self._chosen[camera_topic(name, "image")]).rpartition("/")[2]
        # image_proc and the drivers call rectified images e.g. image_rect_color.
        calibration = convert_calibration(message.content, rectified="rect" in image)
        if self._poses is not None:  # The drivers may use one name for the frames of all cameras.
            calibration.frame_id = optical_frame(name)
        c = calibration
        content = (c.frame_id, c.width, c.height, c.distortion_model, tuple(c.D), tuple(c.K))
        if content == self._calibrations.get(name):
            return
        self._calibrations[name] = content
        self.frames[name] = frame_name(c.frame_id)
        self._write(own, calibration, message.log_time)
        if self._poses is not None:
            self.links.add(parent=self._world, child=c.frame_id)
            pose = self._encoder.transform(
                self._poses[name],
                parent=self._world,
                child=c.frame_id,
                stamp=get_timestamp(c, default=message.log_time),
            )
            self._sink.write(TRANSFORM_TOPIC, pose, time=message.log_time)

    def _write(self, own: str, message: Any, log_time: int) -> None:
        encoded = EncodedMessage(type(message), message.SerializeToString())
        self._sink.write(own, encoded, time=log_time)
