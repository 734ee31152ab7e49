"""Writes a demonstration in the layout of docs/demonstration_format.md."""

import json
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self

import numpy as np

from poil_drake.errors import DemonstrationError
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage
from poil_drake.recording.demonstration.layout import (
    CAMERAS_KEY,
    LABEL_IDS_KEY,
    SCENARIO_ATTACHMENT,
    TRANSFORM_TOPIC,
    WORLD_FRAME,
    WORLD_FRAME_KEY,
    camera_topic,
    optical_frame,
)
from poil_drake.recording.mcap.library_versions import version_metadata
from poil_drake.recording.mcap.message_encoder import ColorEncoding, MessageEncoder
from poil_drake.recording.mcap.sink import McapSink
from poil_drake.recording.mcap.timestamps import to_nanoseconds
from poil_drake.runtime.output_files import whole_file


class DemonstrationWriter:
    """A context manager that writes the frames of a demonstration.

    The file appears under its name only when the `with` block ends without an exception and at
    least two frames were written, so that a failed recording never looks complete.

    Args:
        path: The MCAP file; its folder is created if needed.
        cameras: The names of the cameras that every frame must have, in this order.
        metadata: Entries for the file's metadata, e.g. {"object": "my mug", "seed": "3"}.
        scenario_text: The scenario as YAML, kept as an attachment.
        color: How colour images are encoded; by default JPEG.

    Raises:
        DemonstrationError: on exit, if fewer than two frames were written.
    """

    def __init__(
        self,
        path: str | Path,
        cameras: Sequence[str],
        metadata: Mapping[str, str],
        *,
        scenario_text: str | None = None,
        color: ColorEncoding | None = None,
    ):
        self._path = Path(path)
        self._cameras = tuple(cameras)
        self._metadata = dict(metadata)
        self._label_ids: dict[str, tuple[int, ...]] = {}
        self._written: dict[str, np.ndarray] = {}
        self._frame_count = 0
        self._last_stamps: dict[str, float] = {}
        self._encoder = MessageEncoder(color=color)
        self._file = ExitStack()
        self._sink = McapSink(self._file.enter_context(whole_file(self._path)))
        if scenario_text is not None:
            self._sink.add_attachment(
                SCENARIO_ATTACHMENT, media_type="application/yaml", data=scenario_text.encode()
            )

    def write(self, frame: MultiViewFrame) -> None:
        """Adds a frame.

        Raises:
            DemonstrationError: if the frame's cameras are not those of the writer, or its stamps
                are not later than those of the previous frame.
        """
        names = tuple(camera.name for camera in frame.cameras)
        if names != self._cameras:
            raise DemonstrationError(
                f"{self._path}: a frame has the cameras {names}, but the file has {self._cameras}.",
                remedy="Use the same cameras in the same order in every frame.",
            )
        for camera, image in zip(frame.cameras, frame.images, strict=True):
            if image.stamp <= self._last_stamps.get(camera.name, -1.0):
                raise DemonstrationError(
                    f"{self._path}: an image of camera '{camera.name}' at {image.stamp} s is not "
                    f"later than the previous image, at {self._last_stamps[camera.name]} s.",
                    remedy="Write the frames in chronological order, each only once.",
                )
            self._last_stamps[camera.name] = image.stamp
            self._write_camera(camera, image)
        self._label_ids |= frame.label_ids
        self._frame_count += 1

    def _write_camera(self, camera: CameraModel, image: RgbdImage) -> None:
        encode, frame_id = self._encoder, optical_frame(camera.name)
        stamp = to_nanoseconds(image.stamp)
        messages = {}
        written = self._written.get(camera.name)
        if written is None or not np.array_equal(camera.K, written):
            self._written[camera.name] = camera.K
            topic = camera_topic(camera.name, "calibration")
            messages[topic] = encode.calibration(camera, stamp=stamp, frame_id=frame_id)
        messages[TRANSFORM_TOPIC] = encode.transform(
            camera.X_WC, parent=WORLD_FRAME, child=frame_id, stamp=stamp
        )
        images = {"image": image.rgb, "depth": image.depth, "label": image.label}
        for kind, pixels in images.items():
            if pixels is not None:
                topic = camera_topic(camera.name, kind)
                messages[topic] = encode.image(kind, pixels, stamp=stamp, frame_id=frame_id)
        for topic, message in messages.items():
            self._sink.write(topic, message, time=stamp)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: Any) -> None:
        if exception[0] is not None:
            self._file.__exit__(*exception)
            return
        with self._file:
            self._finish()

    def _finish(self) -> None:
        if self._frame_count < 2:
            raise DemonstrationError(
                f"{self._path} needs at least 2 frames, but has {self._frame_count}.",
                remedy="Record the whole motion.",
            )
        self._sink.add_metadata(
            {
                **version_metadata(),
                "frames": str(self._frame_count),
                **self._metadata,
                CAMERAS_KEY: json.dumps(self._cameras),
                LABEL_IDS_KEY: json.dumps(self._label_ids),
                WORLD_FRAME_KEY: WORLD_FRAME,
            },
        )
        self._sink.close()
