"""The log of a run, as MCAP."""

import atexit
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from poil_drake.perception.images import CameraModel
from poil_drake.recording.demonstration.layout import (
    LABEL_IDS_KEY,
    METADATA_RECORD,
    SCENARIO_ATTACHMENT,
    TRANSFORM_TOPIC,
    WORLD_FRAME,
    camera_topic,
    optical_frame,
)
from poil_drake.recording.mcap.camera_messages import encode_calibration, encode_transform
from poil_drake.recording.mcap.image_messages import (
    ColorEncoding,
    encode_color,
    encode_depth,
    encode_label,
)
from poil_drake.recording.mcap.library_versions import version_metadata
from poil_drake.recording.mcap.log_messages import (
    encode_joint_states,
    encode_points,
    json_record,
    json_schema,
)
from poil_drake.recording.mcap.message_parts import MessageParts
from poil_drake.recording.mcap.sink import McapSink
from poil_drake.recording.mcap.timestamps import to_nanoseconds
from poil_drake.recording.run_log.layout import JOINT_STATES_TOPIC, PHASE_TOPIC, PLAN_ATTACHMENT
from poil_drake.runtime.background_worker import BackgroundWorker


@dataclass(frozen=True, kw_only=True)
class RunLogConfig:
    """How a run is logged.

    Attributes:
        color: How colour images are encoded. A log is for looking at: quality 85 halves its size.
        exact_depth: Whether depth is not rounded to millimetres, which doubles the log's size. With
            colour images that are "raw" or "png", too, a replay then sees what the run saw.
        images: Whether images are written; those of a log without are dropped at once.
        queue_capacity: How many messages may wait for the writing thread. 2048 are more than a
            second at the default rates, and 60 MB with the images among them.
        drop_when_full: Whether a message is left out (and counted in the metadata
            `dropped_messages`) when the queue is full, instead of holding up the caller. True for
            hardware, where the loop must not wait for a disk.
        chunk_size: How much is written at once [bytes, before compression]: what a log lacks at
            most when its process is killed.
    """

    color: ColorEncoding = field(default_factory=lambda: ColorEncoding(jpeg_quality=85))
    exact_depth: bool = False
    images: bool = True
    queue_capacity: int = 2048
    drop_when_full: bool = False
    chunk_size: int = 1 << 20

    @classmethod
    def for_hardware(cls) -> Self:
        """Returns how a real robot's run is logged: nothing waits, and little is lost."""
        return cls(drop_when_full=True, chunk_size=1 << 16)


class RunLogWriter:
    """Writes what happens in a run: open, write, close; or a `with` block.

    All times are those of the loop's context [s], which begin at 0, on hardware, too; `time` is
    when a message was logged, `stamp` when what it shows was measured, by default the same. A write
    copies its arrays and returns; encoding, compression and disk are left to one background thread,
    which `close` joins. The file is readable after any `close`, also one that follows an exception,
    and closing is not forgotten when the interpreter exits.

    A write raises what an earlier write met in the background thread, e.g. a full disk.

    Args:
        path: The MCAP file; its folder is made where needed. An older file is overwritten.
        metadata: What to say about the run, e.g. {"scenario": ..., "seed": ...}.
        scenario_text: The scenario as YAML, kept as an attachment.
        plan: The file of the plan that is executed, kept as an attachment.
        config: How to log.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        metadata: Mapping[str, str] | None = None,
        scenario_text: str | None = None,
        plan: bytes | None = None,
        config: RunLogConfig | None = None,
    ):
        self._config = config or RunLogConfig()
        self._sink = McapSink(Path(path), chunk_size=self._config.chunk_size)
        self._schemas: dict[str, dict[str, Any]] = {}
        self._messages: dict[tuple[str, ...], Any] = {}
        self._closed = False
        # Metadata first: a log that was never closed still says what it is.
        self._sink.add_metadata(METADATA_RECORD, {**version_metadata(), **(metadata or {})})
        if scenario_text is not None:
            self._sink.add_attachment(
                SCENARIO_ATTACHMENT, media_type="application/yaml", data=scenario_text.encode()
            )
        if plan is not None:
            self._sink.add_attachment(PLAN_ATTACHMENT, media_type="application/zip", data=plan)
        self._worker = BackgroundWorker(name="run_log", capacity=self._config.queue_capacity)
        atexit.register(self.close)

    def write_calibration(self, camera: CameraModel, *, time: float) -> None:
        """Writes a camera's intrinsics and pose."""
        now = to_nanoseconds(time)
        frame_id = optical_frame(camera.name)
        topic = camera_topic(camera.name, "calibration")
        self._write(topic, time, lambda: encode_calibration(camera, stamp=now, frame_id=frame_id))
        self.write_transform(camera.X_WC, child=frame_id, time=time)

    def write_image(
        self, camera: str, rgb: np.ndarray, *, time: float, stamp: float | None = None
    ) -> None:
        """Writes an (H, W, 3) uint8 colour image."""
        encode = partial(encode_color, encoding=self._config.color)
        self._write_pixels(camera, "image", rgb, encode, time, stamp)

    def write_depth(
        self, camera: str, depth: np.ndarray, *, time: float, stamp: float | None = None
    ) -> None:
        """Writes an (H, W) depth image [m]."""
        encode = partial(encode_depth, exact=self._config.exact_depth)
        self._write_pixels(camera, "depth", depth, encode, time, stamp)

    def write_label(
        self, camera: str, label: np.ndarray, *, time: float, stamp: float | None = None
    ) -> None:
        """Writes an (H, W) label image."""
        self._write_pixels(camera, "label", label, encode_label, time, stamp)

    def write_label_ids(self, label_ids: Mapping[str, Sequence[int]]) -> None:
        """Writes as metadata which labels stand for what; see `MultiViewFrame.label_ids`."""
        text = json.dumps({name: list(ids) for name, ids in label_ids.items()})
        self._submit(lambda: self._sink.add_metadata(METADATA_RECORD, {LABEL_IDS_KEY: text}))

    def write_points(
        self,
        name: str,
        points: np.ndarray,
        *,
        time: float,
        stamp: float | None = None,
        confidence: np.ndarray | None = None,
        exact: bool = False,
    ) -> None:
        """Writes (N, 3) world points [m] to /points/<name>, with their (N,) confidence if given.

        The names in use are tracked, propagated, reference and target. They are rounded to float32
        unless they are to be `exact`.
        """
        captured = to_nanoseconds(time if stamp is None else stamp)
        kept = _kept(points)
        weights = None if confidence is None else _kept(confidence)
        topic, has_confidence = f"/points/{name}", weights is not None
        self._write(
            topic,
            time,
            lambda: self._again(
                (topic, str(exact), str(has_confidence)),
                lambda message: encode_points(
                    kept,
                    stamp=captured,
                    frame_id=WORLD_FRAME,
                    confidence=weights,
                    exact=exact,
                    message=message,
                ),
            ),
        )

    def write_transform(
        self, X_PC: np.ndarray, *, child: str, time: float, parent: str = WORLD_FRAME
    ) -> None:
        """Writes the (4, 4) pose of frame `child` in frame `parent` [m] to /tf."""
        now = to_nanoseconds(time)
        pose = _kept(X_PC)
        self._write(
            TRANSFORM_TOPIC,
            time,
            lambda: self._again(
                (TRANSFORM_TOPIC, parent, child),
                lambda message: encode_transform(
                    pose, parent=parent, child=child, stamp=now, message=message
                ),
            ),
        )

    def write_joint_states(
        self,
        names: Sequence[str],
        *,
        time: float,
        position: np.ndarray | None = None,
        velocity: np.ndarray | None = None,
        effort: np.ndarray | None = None,
        topic: str = JOINT_STATES_TOPIC,
    ) -> None:
        """Writes the (J,) positions [rad], velocities [rad/s] and torques [Nm] of named joints."""
        now = to_nanoseconds(time)
        given = {"position": position, "velocity": velocity, "effort": effort}
        kept = {key: None if array is None else _kept(array) for key, array in given.items()}
        self._write(
            topic,
            time,
            lambda: self._again(
                (topic, *names),
                lambda message: encode_joint_states(names, stamp=now, message=message, **kept),
            ),
        )

    def write_twist(self, topic: str, twist: np.ndarray, *, time: float) -> None:
        """Writes a (6,) spatial velocity, (ω [rad/s], v [m/s]) in the world, to `topic`."""
        angular, linear = np.split(np.asarray(twist, dtype=float), 2)
        axes = "xyz"
        self._write_json(
            topic,
            {
                "angular": dict(zip(axes, angular.tolist(), strict=True)),
                "linear": dict(zip(axes, linear.tolist(), strict=True)),
            },
            title="poil.Twist",
            time=time,
        )

    def write_status(self, topic: str, values: Mapping[str, Any], *, time: float) -> None:
        """Writes named values to `topic`, e.g. /controller/status, /ik/status, /tracker/status.

        The values may be numbers, text, arrays and mappings of these. The first message on a topic
        sets its JSON schema, so give every message of a topic the same names.
        """
        self._write_json(topic, values, title=f"poil{topic.replace('/', '.')}", time=time)

    def write_phase(self, phase: str, *, time: float, reason: str = "") -> None:
        """Writes to /phase that a phase of the task has begun, and why."""
        values = {"phase": phase, "reason": reason}
        self._write_json(PHASE_TOPIC, values, title="poil.phase", time=time)

    def close(self) -> None:
        """Waits for the background thread and finishes the file. A second call does nothing.

        Raises:
            OSError: if the file could not be written. It is closed all the same.
        """
        if self._closed:
            return
        self._closed = True
        atexit.unregister(self.close)
        try:
            self._worker.close()
        finally:
            if self._worker.dropped:
                dropped = {"dropped_messages": str(self._worker.dropped)}
                self._sink.add_metadata(METADATA_RECORD, dropped)
            self._sink.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        exception_type: type[BaseException] | None,
        exception: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def _write_pixels(
        self,
        camera: str,
        kind: str,
        image: np.ndarray,
        encode: Callable[..., Any],
        time: float,
        stamp: float | None,
    ) -> None:
        if not self._config.images:
            return
        captured = to_nanoseconds(time if stamp is None else stamp)
        topic, frame_id, pixels = camera_topic(camera, kind), optical_frame(camera), _kept(image)
        self._write(
            topic,
            time,
            lambda: self._again(
                (topic, str(pixels.shape)),
                lambda message: encode(pixels, stamp=captured, frame_id=frame_id, message=message),
            ),
        )

    def _again(self, key: tuple[str, ...], encode: Callable[[Any], Any]) -> Any:
        """Returns a message that is filled again each time, in the background thread.

        Of every 10,000 pieces of messages that are freed, protobuf has the last one's thread go
        through all free memory of the process and give it back (`malloc_trim`). That takes 10 ms,
        in which no other thread gets the interpreter, and slows down who uses memory next. The
        robot's signals alone would make it do so every few seconds.
        """
        encoded = encode(self._messages.get(key))
        self._messages[key] = encoded.message if isinstance(encoded, MessageParts) else encoded
        return encoded

    def _write(self, topic: str, time: float, encode: Callable[[], Any]) -> None:
        now = to_nanoseconds(time)
        self._submit(lambda: self._sink.write(topic, encode(), time=now))

    def _write_json(
        self, topic: str, values: Mapping[str, Any], *, title: str, time: float
    ) -> None:
        now = to_nanoseconds(time)
        record = json_record(values, stamp=now)
        if title not in self._schemas:
            self._schemas[title] = json_schema(title, record)
        schema = self._schemas[title]
        self._submit(lambda: self._sink.write_json(topic, record, schema=schema, time=now))

    def _submit(self, job: Callable[[], None]) -> None:
        self._worker.submit(job, may_drop=self._config.drop_when_full)


def _kept(array: np.ndarray) -> np.ndarray:
    """Returns an array that nobody changes: itself if it is read-only and its own, or a copy."""
    array = np.asarray(array)
    return array if not array.flags.writeable and array.base is None else array.copy()
