"""ROS 2 bags of two RealSense cameras, written with a library that the package does not use."""

import sqlite3
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from mcap.reader import make_reader
from mcap_ros2.writer import Writer
from scipy.spatial.transform import Rotation
from small_frames import HEIGHT, WIDTH, K, camera, image

MakeImage = Callable[[np.ndarray, int, str], tuple[str, Any]]

_HEADER = """\
===
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
===
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
DEFINITIONS = {
    "sensor_msgs/msg/Image": "std_msgs/Header header\nuint32 height\nuint32 width\n"
    "string encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data\n" + _HEADER,
    "sensor_msgs/msg/CompressedImage": "std_msgs/Header header\nstring format\nuint8[] data\n"
    + _HEADER,
    "sensor_msgs/msg/CameraInfo": "std_msgs/Header header\nuint32 height\nuint32 width\n"
    "string distortion_model\nfloat64[] d\nfloat64[9] k\nfloat64[9] r\nfloat64[12] p\n"
    "uint32 binning_x\nuint32 binning_y\nsensor_msgs/RegionOfInterest roi\n" + _HEADER + "===\n"
    "MSG: sensor_msgs/RegionOfInterest\nuint32 x_offset\nuint32 y_offset\nuint32 height\n"
    "uint32 width\nbool do_rectify\n",
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n" + _HEADER + "===\n"
    "MSG: geometry_msgs/TransformStamped\nstd_msgs/Header header\nstring child_frame_id\n"
    "geometry_msgs/Transform transform\n===\nMSG: geometry_msgs/Transform\n"
    "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n===\n"
    "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n===\n"
    "MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    "std_msgs/msg/String": "string data\n",
}


def header(stamp: int, frame: str) -> dict[str, Any]:
    seconds, nanoseconds = divmod(stamp, 10**9)
    return {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": frame}


def raw_image(encoding: str, pixels: np.ndarray, stamp: int, frame: str) -> tuple[str, Any]:
    """Returns a sensor_msgs/Image of (H, W) or (H, W, C) pixels; the stamp is in [ns]."""
    content = {
        "header": header(stamp, frame),
        "height": pixels.shape[0],
        "width": pixels.shape[1],
        "encoding": encoding,
        "step": pixels.nbytes // len(pixels),
        "data": pixels.tobytes(),
    }
    return "sensor_msgs/msg/Image", content


def compressed_image(form: str, data: bytes, stamp: int, frame: str) -> tuple[str, Any]:
    content = {"header": header(stamp, frame), "format": form, "data": data}
    return "sensor_msgs/msg/CompressedImage", content


def compressed_depth(millimetres: np.ndarray, stamp: int, frame: str) -> tuple[str, Any]:
    """Returns a depth image as `compressed_depth_image_transport` sends it."""
    _, png = cv2.imencode(".png", millimetres)
    return compressed_image("16UC1; compressedDepth png", bytes(12) + png.tobytes(), stamp, frame)


def compressed_float_depth(millimetres: np.ndarray, stamp: int, frame: str) -> tuple[str, Any]:
    """Returns a 32FC1 depth image as that transport quantizes it: 1 / z = (pixel - b) / a."""
    a, b = 100.0 * 101.0, 1.0 - 100.0 * 101.0 / 10.0  # Its defaults: 10 m, quantization 100.
    metres = np.where(millimetres > 0, millimetres / 1000.0, np.inf)
    pixels = np.where(millimetres > 0, a / metres + b, 0.0).astype(np.uint16)
    _, png = cv2.imencode(".png", pixels)
    data = struct.pack("<iff", 0, a, b) + png.tobytes()
    return compressed_image("32FC1; compressedDepth png", data, stamp, frame)


def camera_info(
    K: np.ndarray, size: tuple[int, int], stamp: int, frame: str, **fields: Any
) -> tuple[str, Any]:
    content = {
        "header": header(stamp, frame),
        "width": size[0],
        "height": size[1],
        "distortion_model": "plumb_bob",
        "d": [0.0] * 5,
        "k": K.ravel().tolist(),
        "r": np.eye(3).ravel().tolist(),
        "p": np.hstack([K, np.zeros((3, 1))]).ravel().tolist(),
        "roi": {},
    }
    return "sensor_msgs/msg/CameraInfo", content | fields


def transforms(stamp: int, *links: tuple[str, str, np.ndarray]) -> tuple[str, Any]:
    """Returns a tf2_msgs/TFMessage of parents, children and (4, 4) poses [m]."""
    entries = []
    for parent, child, X_PC in links:
        q = Rotation.from_matrix(X_PC[:3, :3]).as_quat().tolist()
        transform = {
            "translation": dict(zip("xyz", X_PC[:3, 3].tolist(), strict=True)),
            "rotation": dict(zip("xyzw", q, strict=True)),
        }
        entries.append(
            {"header": header(stamp, parent), "child_frame_id": child, "transform": transform}
        )
    return "tf2_msgs/msg/TFMessage", {"transforms": entries}


@dataclass
class RosRecording:
    """What `ros2 bag record` hears from two RealSense cameras; to be changed before it is written.

    Attributes:
        messages: The messages: topic, time of logging [ns], type and content.
        start: The time of the first image [ns].
    """

    messages: list[tuple[str, int, str, Any]] = field(default_factory=list)
    start: int = 1_764_500_000_000_000_000

    @classmethod
    def of_small_frames(
        cls, *, color: MakeImage | None = None, depth: MakeImage | None = None
    ) -> "RosRecording":
        """Returns a recording of five images of `small_frames`, at 8 Hz.

        `color` and `depth` make a message from pixels (depth in [mm]), stamp [ns] and frame.
        """
        make_color = color or partial(raw_image, "rgb8")
        make_depth = depth or partial(raw_image, "16UC1")
        dut = cls()
        for name in ("left", "right"):
            optical, link = f"{name}_color_optical_frame", f"{name}_link"
            # As the driver has it: the camera's body looks along x, its optical frame along z.
            X_LO = np.eye(4)
            X_LO[:3, :3] = [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]
            X_WL = camera(name).X_WC @ np.linalg.inv(X_LO)
            dut.add("/tf_static", 0, transforms(dut.start, ("world", link, X_WL)))
            dut.add("/tf_static", 0, transforms(dut.start, (link, optical, X_LO)))
            for i in range(5):
                time = i * 10**9 // 8
                stamp, view = dut.start + time, image(i, stamp=i / 8)
                millimetres = np.rint(1000 * view.depth).astype("<u2")
                for topic, content in {
                    "color/image_raw": make_color(view.rgb, stamp, optical),
                    "color/camera_info": camera_info(K, (WIDTH, HEIGHT), stamp, optical),
                    "aligned_depth_to_color/image_raw": make_depth(millimetres, stamp, optical),
                }.items():
                    dut.add(f"/{name}/{topic}", time + 10_000_000, content)
        return dut

    def add(self, topic: str, time: int, message: tuple[str, Any]) -> None:
        """Adds a message that is logged `time` [ns] after the start."""
        self.messages.append((topic, self.start + time, *message))

    def edit(self, topic: str, change: Callable[[Any], Any]) -> None:
        """Replaces the contents of a topic's messages."""
        self.messages = [(*m[:3], change(m[3])) if m[0] == topic else m for m in self.messages]

    def set_frame(self, topic: str, frame: str) -> None:
        """Sets the frame in the headers of a topic's messages."""
        self.edit(topic, lambda old: old | {"header": old["header"] | {"frame_id": frame}})

    def drop(self, topic: str) -> None:
        """Removes a topic."""
        self.messages = [message for message in self.messages if message[0] != topic]

    def rename(self, topic: str, new: str) -> None:
        """Gives a topic another name."""
        self.messages = [(new if m[0] == topic else m[0], *m[1:]) for m in self.messages]

    def write_mcap(self, path: Path) -> Path:
        """Writes one MCAP file."""
        with path.open("wb") as stream, Writer(stream) as writer:
            schemas = {k: writer.register_msgdef(k, text) for k, text in DEFINITIONS.items()}
            for topic, time, kind, content in sorted(self.messages, key=lambda m: m[1]):
                writer.write_message(topic, schemas[kind], content, log_time=time)
        return path

    def write_folder(self, folder: Path) -> Path:
        """Writes a folder with an MCAP file, as ROS 2 Jazzy does by default."""
        folder.mkdir()
        self.write_mcap(folder / f"{folder.name}_0.mcap")
        self._write_metadata(folder, "mcap", f"{folder.name}_0.mcap")
        return folder

    def write_db3(self, folder: Path) -> Path:
        """Writes a folder with an SQLite file, as ROS 2 Humble does by default."""
        folder.mkdir()
        source = self.write_mcap(folder / "source.mcap")
        database = sqlite3.connect(folder / f"{folder.name}_0.db3")
        database.executescript(
            "CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);"
            "CREATE TABLE metadata(id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL,"
            " metadata TEXT NOT NULL);"
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,"
            " serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,"
            " timestamp INTEGER NOT NULL, data BLOB NOT NULL);"
            "CREATE INDEX timestamp_idx ON messages (timestamp ASC);"
            "INSERT INTO schema(schema_version, ros_distro) VALUES (3, 'humble');"
        )
        ids: dict[str, int] = {}
        with source.open("rb") as stream:
            for schema, channel, message in make_reader(stream).iter_messages():
                if channel.topic not in ids:
                    ids[channel.topic] = len(ids) + 1
                    row = (ids[channel.topic], channel.topic, schema.name, "cdr", "")
                    database.execute("INSERT INTO topics VALUES(?, ?, ?, ?, ?)", row)
                entry = (ids[channel.topic], message.log_time, message.data)
                database.execute(
                    "INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)", entry
                )
        database.commit()
        database.close()
        source.unlink()
        self._write_metadata(folder, "sqlite3", f"{folder.name}_0.db3")
        return folder

    def _write_metadata(self, folder: Path, storage: str, file: str) -> None:
        times = [time for _, time, _, _ in self.messages]
        kinds = {topic: kind for topic, _, kind, _ in self.messages}
        information = {
            "version": 5,
            "storage_identifier": storage,
            "duration": {"nanoseconds": max(times) - min(times)},
            "starting_time": {"nanoseconds_since_epoch": min(times)},
            "message_count": len(times),
            "topics_with_message_count": [
                {
                    "topic_metadata": {
                        "name": topic,
                        "type": kind,
                        "serialization_format": "cdr",
                        "offered_qos_profiles": "",
                    },
                    "message_count": sum(name == topic for name, *_ in self.messages),
                }
                for topic, kind in kinds.items()
            ],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [file],
            "files": [],
        }
        text = yaml.safe_dump({"rosbag2_bagfile_information": information})
        (folder / "metadata.yaml").write_text(text)
