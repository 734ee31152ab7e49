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
    LIVE_KEY,
    SCENARIO_ATTACHMENT,
    TRANSFORM_TOPIC,
    WORLD_FRAME,
    WORLD_FRAME_KEY,
    camera_topic,
    optical_frame,
)
from poil_drake.recording.mcap.library_versions import version_metadata
from poil_drake.recording.mcap.message_encoder import ColorEncoding, EncodedMessage, MessageEncoder
from poil_drake.recording.mcap.sink import McapSink
from poil_drake.recording.mcap.timestamps import to_nanoseconds
from poil_drake.runtime.output_files import new_file, whole_file

_LIVE_CHUNK = 1 << 16
"""How much of a live recording is written at once [bytes, before compression]: less than an image,
so that at most the last few images are lost if the process is killed."""


class DemonstrationWriter:
    """A context manager that writes a demonstration, in frames or image by image.

    The file appears under its name only when the `with` block ends without an exception and at
    least two frames were written, so that a failed recording never looks complete.

    A `live` recording, which cannot be repeated, is kept instead whatever happens. Its file must be
    new, grows under its name, and is complete when the block ends, even with an exception. If the
    process is killed or the disk is full, `load_demonstration` loads the chunks on the disk.

    Args:
        path: The MCAP file; its folder is created if needed.
        cameras: The names of the cameras that every frame must have, in this order.
        metadata: Entries for the file's metadata, e.g. {"object": "my mug", "seed": "3"}.
        scenario_text: The scenario as YAML, kept as an attachment.
        color: How colour images are encoded; by default JPEG.
        exact_depth: Whether depth is written without rounding to millimetres.
        label_ids: See `MultiViewFrame.label_ids`; `write` adds those of its frames.
        live: Whether the recording is live.

    Raises:
        DemonstrationError: on exit, if fewer than two frames were written and the recording is not
            live.
        OutputError: if a live recording's file exists.
    """

    def __init__(
        self,
        path: str | Path,
        cameras: Sequence[str],
        metadata: Mapping[str, str],
        *,
        scenario_text: str | None = None,
        color: ColorEncoding | None = None,
        exact_depth: bool = False,
        label_ids: Mapping[str, tuple[int, ...]] | None = None,
        live: bool = False,
    ):
        self._path, self._live = Path(path), live
        self._cameras = tuple(cameras)
        self._metadata = dict(metadata)
        self._label_ids = dict(label_ids or {})
        self._written: dict[str, np.ndarray] = {}
        self._frame_count = 0
        self._last_stamps: dict[str, float] = {}
        self._encoder = MessageEncoder(color=color, exact_depth=exact_depth)
        self._file = ExitStack()
        if live:
            self._sink = McapSink(new_file(self._path), chunk_size=_LIVE_CHUNK)
            self._sink.add_metadata({LIVE_KEY: "true", **self._description()})
        else:
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
            self.write_image(camera, image)
        self._label_ids |= frame.label_ids
        self._frame_count += 1

    def write_image(self, camera: CameraModel, image: RgbdImage) -> None:
        """Adds an image of one camera; for cameras that do not capture at the same time.

        Raises:
            DemonstrationError: if its stamp is not later than that of the camera's previous image.
            OSError: if the file cannot be written, e.g. because the disk is full.
        """
        if image.stamp <= self._last_stamps.get(camera.name, -1.0):
            raise DemonstrationError(
                f"{self._path}: an image of camera '{camera.name}' at {image.stamp} s is not "
                f"later than the previous image, at {self._last_stamps[camera.name]} s.",
                remedy="Write the images in chronological order, each only once.",
            )
        self._last_stamps[camera.name] = image.stamp
        written = self._written.get(camera.name)
        is_new = written is None or not np.array_equal(camera.K, written)
        self._written[camera.name] = camera.K
        messages = encode_image(self._encoder, camera, image, calibration=is_new)
        self.write_messages(messages, stamp=image.stamp)

    def write_messages(self, messages: Mapping[str, EncodedMessage], *, stamp: float) -> None:
        """Adds the messages of an image with a `stamp` [s], made by `encode_image`.

        Raises:
            OSError: if the file cannot be written, e.g. because the disk is full.
        """
        for topic, message in messages.items():
            self._sink.write(topic, message, time=to_nanoseconds(stamp))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: Any) -> None:
        if self._live:
            self._sink.close()
            return
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
        self._sink.add_metadata({"frames": str(self._frame_count), **self._description()})
        self._sink.close()

    def _description(self) -> dict[str, str]:
        return {
            **version_metadata(),
            **self._metadata,
            CAMERAS_KEY: json.dumps(self._cameras),
            LABEL_IDS_KEY: json.dumps(self._label_ids),
            WORLD_FRAME_KEY: WORLD_FRAME,
        }


def encode_image(
    encoder: MessageEncoder, camera: CameraModel, image: RgbdImage, *, calibration: bool
) -> dict[str, EncodedMessage]:
    """Returns the messages of an image, of its camera's pose and maybe calibration, by topic."""
    frame_id, stamp = optical_frame(camera.name), to_nanoseconds(image.stamp)
    messages = {}
    if calibration:
        topic = camera_topic(camera.name, "calibration")
        messages[topic] = encoder.calibration(camera, stamp=stamp, frame_id=frame_id)
    messages[TRANSFORM_TOPIC] = encoder.transform(
        camera.X_WC, parent=WORLD_FRAME, child=frame_id, stamp=stamp
    )
    images = {"image": image.rgb, "depth": image.depth, "label": image.label}
    for kind, pixels in images.items():
        if pixels is not None:
            topic = camera_topic(camera.name, kind)
            messages[topic] = encoder.image(kind, pixels, stamp=stamp, frame_id=frame_id)
    return messages
