"""Imports a ROS bag as a demonstration."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np

from poil_drake.errors import DemonstrationError, InvalidValueError
from poil_drake.recording.demonstration.demonstration import load_demonstration
from poil_drake.recording.demonstration.layout import (
    CAMERAS_KEY,
    LABEL_IDS_KEY,
    WORLD_FRAME,
    WORLD_FRAME_KEY,
)
from poil_drake.recording.mcap.message_decoders import frame_name
from poil_drake.recording.mcap.sink import McapSink
from poil_drake.recording.mcap.timestamps import to_seconds
from poil_drake.recording.ros_bag.bag import IMAGES, TRANSFORMS, RosBag
from poil_drake.recording.ros_bag.converter import BagConverter
from poil_drake.recording.ros_bag.topic_choice import choose_topics
from poil_drake.runtime.output_files import require_writable, whole_file


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
    start: float = 0.0,
    end: float = math.inf,
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
        start: Images that were logged earlier are left out [s since the first image].
        end: Images that were logged later are left out [s since the first image].

    Raises:
        DemonstrationError: if the bag is damaged, lacks something, or makes no valid demonstration.
        OutputError: if the output cannot be written, or is the bag or in its folder.
    """
    require_writable(Path(output), inputs=(path,))
    world = frame_name(world)
    with RosBag(path) as bag, whole_file(Path(output)) as stream:
        chosen = choose_topics(bag, cameras, topics or {})
        converter = BagConverter(McapSink(stream), chosen, posed=poses is not None)
        transforms = [name for name, topic in bag.topics.items() if topic.type == TRANSFORMS]
        first, kept = None, set[str]()
        for message in bag.messages([*chosen.values(), *transforms]):
            if message.type in IMAGES:
                first = message.log_time if first is None else first
                if not start <= to_seconds(message.log_time - first) <= end:
                    continue
                kept.add(message.topic)
            with _named(f"{bag.path}, topic {message.topic}"):
                converter.add(message)
        for topic in chosen.values():
            if bag.topics[topic].type in IMAGES and topic not in kept:
                raise DemonstrationError(
                    f"{bag.path}: no image of topic {topic} was logged from {start:g} s to {end:g} "
                    "s after the first image.",
                    remedy="Correct --start and --end.",
                )
        for name, X_WC in (poses or {}).items():
            with _named(f"{bag.path}, camera '{name}'"):
                converter.add_pose(name, world, X_WC)
        converter.finish(
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
            problem = error.problem.replace(stream.name, str(bag.path))
            named = [f"{own} is {topic}" for own, topic in chosen.items() if own in problem]
            if named:
                problem += f" In the bag, {', '.join(named)}."
            raise DemonstrationError(problem, remedy=error.remedy) from error
    return ImportedBag(chosen, len(demonstration.frames), demonstration.duration)


@contextmanager
def _named(source: str) -> Iterator[None]:
    """Turns an InvalidValueError into a DemonstrationError that names its source."""
    try:
        yield
    except InvalidValueError as error:
        raise DemonstrationError(f"{source}: {error.problem}", remedy=error.remedy) from error
