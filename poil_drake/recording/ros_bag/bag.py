"""Reads ROS bags with the library `rosbags`; any damage raises a `DemonstrationError`."""

from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager
from heapq import merge
from itertools import islice
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple, Self

from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

from poil_drake.errors import DemonstrationError

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
TRANSFORMS = "tf2_msgs/msg/TFMessage"

IMAGES = (IMAGE, COMPRESSED_IMAGE)
READ_TYPES = (*IMAGES, CAMERA_INFO, TRANSFORMS)
"""The types of messages that a demonstration is made of."""

_ROS_1 = ".bag"
_SUFFIXES = (".mcap", ".db3", _ROS_1)


class BagTopic(NamedTuple):
    """What a bag says about one of its topics.

    Attributes:
        type: The type of its messages, e.g. "sensor_msgs/msg/Image".
        messages: The number of messages.
    """

    type: str
    messages: int


class BagMessage(NamedTuple):
    """A message in a bag.

    Attributes:
        topic: Its topic.
        type: Its type, one of `READ_TYPES`.
        log_time: When it was logged [ns].
        content: The message, with the fields of its ROS type.
    """

    topic: str
    type: str
    log_time: int
    content: Any


class RosBag:
    """A context manager that reads a bag of ROS 2 (MCAP or SQLite) or ROS 1.

    Args:
        path: A bag's folder, or one of its files: .mcap, .db3 or .bag. A folder without
            metadata.yaml, e.g. because its recorder was killed, is read file by file.

    Attributes:
        path: The path.
        topics: The topics by name, sorted.

    Raises:
        DemonstrationError: if the bag cannot be read.
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)
        self.topics: dict[str, BagTopic] = {}
        self._stack = ExitStack()
        self._readers: list[Any] = []

    def __enter__(self) -> Self:
        files = _files(self.path)
        with _explained(self.path), ExitStack() as opening:
            for file in files:
                reader = rosbag1.Reader(file) if file.suffix == _ROS_1 else rosbag2.Reader(file)
                self._readers.append(opening.enter_context(reader))
            self._stack = opening.pop_all()
        connections = [c for reader in self._readers for c in reader.connections]
        for name in sorted({c.topic for c in connections}):
            same = [c for c in connections if c.topic == name]
            types = " and ".join(sorted({c.msgtype for c in same}))
            self.topics[name] = BagTopic(types, sum(c.msgcount for c in same))
        return self

    def __exit__(self, *exception: Any) -> None:
        self._stack.close()

    def messages(self, topics: Collection[str]) -> Iterator[BagMessage]:
        """Yields the messages of topics whose types are in `READ_TYPES`, by the time of logging.

        The messages are decoded by the definitions of their ROS types, not by those in the bag,
        which old bags lack.

        Raises:
            DemonstrationError: if the bag is damaged.
        """
        with _explained(self.path):
            streams = [self._decoded(reader, topics) for reader in self._readers]
            yield from merge(*streams, key=attrgetter("log_time"))

    def _decoded(self, reader: Any, topics: Collection[str]) -> Iterator[BagMessage]:
        """Yields the messages of topics in one file, by the time of logging."""
        ros2 = get_typestore(Stores.ROS2_HUMBLE)
        decode = ros2.deserialize_cdr
        if isinstance(reader, rosbag1.Reader):
            ros1 = get_typestore(Stores.ROS1_NOETIC)
            ros1.register({TRANSFORMS: ros2.fielddefs[TRANSFORMS]})
            decode = ros1.deserialize_ros1
        wanted = [c for c in reader.connections if c.topic in topics]
        # The library takes an empty list for all topics.
        for connection, log_time, data in reader.messages(connections=wanted) if wanted else ():
            kind = connection.msgtype
            yield BagMessage(connection.topic, kind, log_time, decode(data, kind))

    def listing(self) -> str:
        """Returns one sentence with the topics of types in `READ_TYPES`, for error messages.

        It has the type, the number of messages and the frame of each.
        """
        entries = []
        for name, (message_type, messages) in self.topics.items():
            if message_type in READ_TYPES:
                entry = f"{messages} {message_type}"
                for first in islice(self.messages([name]), message_type != TRANSFORMS):
                    entry += f" in frame '{first.content.header.frame_id}'"
                entries.append(f"{name} ({entry})")
        others = len(self.topics) - len(entries)
        return f"The bag holds {', '.join(entries) or 'no topic of ' + ', '.join(READ_TYPES)}" + (
            f"; and {others} of other types." if others else "."
        )


def _files(path: Path) -> list[Path]:
    """Returns what the library opens: a bag's folder or file, or all files in a folder.

    Raises:
        DemonstrationError: if there is no bag.
    """
    if path.is_dir() and not (path / "metadata.yaml").exists():
        files = sorted(file for file in path.iterdir() if file.suffix in _SUFFIXES)
    else:
        files = [path] if path.is_dir() or path.suffix in _SUFFIXES else []
    if not files:
        raise DemonstrationError(
            f"{path} is not a ROS bag: it is neither a file that ends in {', '.join(_SUFFIXES)} "
            "nor a folder with one.",
            remedy="Name the folder that `ros2 bag record` wrote, or one of its files.",
        )
    return files


@contextmanager
def _explained(path: Path) -> Iterator[None]:
    """Turns errors of reading a bag into a `DemonstrationError`."""
    try:
        yield
    except OSError as error:
        raise DemonstrationError(
            f"{path} cannot be read: {error.strerror or error}.",
            remedy="Check the path and its permissions.",
        ) from error
    except Exception as error:  # The library and its parsers raise many types on damaged bytes.
        raise DemonstrationError(
            f"{path} cannot be read as a ROS bag: {str(error).rstrip('.') or type(error).__name__}"
            ".",
            remedy="If `ros2 bag info` cannot read it either, repair it with `ros2 bag reindex` or "
            "`mcap recover`; if it can, convert it with `rosbags-convert`.",
        ) from error
