"""Small scenes, and recordings of other tools."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from mcap_protobuf.writer import Writer
from small_frames import HEIGHT, WIDTH, K, image

from poil_drake.recording.demonstration.demonstration import Demonstration, load_demonstration


@dataclass
class ForeignRecording:
    """A recording of two cameras "left" and "right", to be changed before it is written.

    Attributes:
        path: Where it is written.
        times: The stamps of each stream of images [s], by topic.
        color: Makes a colour message from index, time and frame.
        depth: Makes a depth message from index, time and frame.
        transforms: What is written to /tf.
        calibrations: The calibration of each camera; None leaves it out.
        options: Options of the MCAP writer.
        metadata: The metadata record "poil"; None omits it.
        log_offset: Delay from capture to log of all messages [s].
    """

    path: Path
    times: dict[str, list[float]] = field(default_factory=dict)
    color: Callable[[int, float, str], Any] = lambda i, t, frame: ForeignRecording.raw(
        "rgb8", image(i, stamp=t).rgb, t, frame
    )
    depth: Callable[[int, float, str], Any] = lambda i, t, frame: ForeignRecording.raw(
        "16UC1", np.rint(1000 * image(i, stamp=t).depth).astype("<u2"), t, frame
    )
    transforms: list[Any] = field(default_factory=list)
    calibrations: dict[str, CameraCalibration | None] = field(default_factory=dict)
    options: dict[str, Any] = field(default_factory=dict)
    metadata: dict[str, str] | None = None
    log_offset: float = 0.0

    image = staticmethod(image)

    @staticmethod
    def raw(encoding: str, pixels: np.ndarray, time: float | None, frame_id: str = "") -> RawImage:
        message = RawImage(
            encoding=encoding,
            data=pixels.tobytes(),
            height=len(pixels),
            width=pixels.shape[1],
            step=pixels.nbytes // len(pixels),
            frame_id=frame_id,
        )
        if time is not None:
            message.timestamp.FromNanoseconds(round(time * 1e9))
        return message

    @staticmethod
    def transform(parent: str, child: str, translation: tuple[float, ...]) -> FrameTransform:
        message = FrameTransform(parent_frame_id=parent, child_frame_id=child)
        message.translation.x, message.translation.y, message.translation.z = translation
        message.rotation.x = 1.0  # Half a turn about x: looks down.
        return message

    def __post_init__(self) -> None:
        for name in ("left", "right"):
            for kind in ("image", "depth"):
                self.times[f"/camera/{name}/{kind}"] = [i / 8 for i in range(5)]
            frame = f"{name}_lens"
            self.transforms.append(self.transform("world", frame, (0.4, 0.1 * len(name), 0.6)))
            self.calibrations[name] = CameraCalibration(
                frame_id=frame, width=WIDTH, height=HEIGHT, K=K.ravel()
            )

    def load(
        self, extra: Callable[[Writer], None] | None = None, cameras: list[str] | None = None
    ) -> Demonstration:
        """Writes the recording, with `extra` messages, and loads it."""
        with self.path.open("wb") as stream, Writer(stream, **self.options) as writer:
            for message in self.transforms:
                self._log(writer, "/tf", message, 0.0)
            for name, calibration in self.calibrations.items():
                if calibration is not None:
                    self._log(writer, f"/camera/{name}/calibration", calibration, 0.0)
            for topic, times in self.times.items():
                _, _, name, kind = topic.split("/")
                make = self.color if kind == "image" else self.depth
                for i, time in enumerate(times):
                    self._log(writer, topic, make(i, time, f"{name}_lens"), time)
            if self.metadata is not None:
                writer.add_metadata("poil", self.metadata)
            if extra is not None:
                extra(writer)
        return load_demonstration(self.path, cameras=cameras)

    def _log(self, writer: Writer, topic: str, message: Any, time: float) -> None:
        log_time = round((time + self.log_offset) * 1e9)
        writer.write_message(topic, message, log_time=log_time, publish_time=log_time)


@pytest.fixture
def foreign(tmp_path: Path) -> ForeignRecording:
    return ForeignRecording(tmp_path / "demo.mcap")
