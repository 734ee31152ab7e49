"""Writes the log of a run as an MCAP file."""

import atexit
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Self

import numpy as np

from poil_drake.perception.images import CameraModel
from poil_drake.recording.demonstration.layout import (
    LABEL_IDS_KEY,
    SCENARIO_ATTACHMENT,
    TRANSFORM_TOPIC,
    WORLD_FRAME,
    camera_topic,
    optical_frame,
)
from poil_drake.recording.mcap.library_versions import version_metadata
from poil_drake.recording.mcap.message_encoder import ColorEncoding, EncodedMessage, MessageEncoder
from poil_drake.recording.mcap.plain_json import json_record
from poil_drake.recording.mcap.sink import McapSink
from poil_drake.recording.mcap.timestamps import to_nanoseconds
from poil_drake.recording.run_log.layout import JOINT_STATES_TOPIC, PHASE_TOPIC, PLAN_ATTACHMENT
from poil_drake.runtime.background_thread import BackgroundWorker


@dataclass(frozen=True, kw_only=True)
class RunLogConfig:
    """How a run is logged.

    Attributes:
        color: How colour images are encoded. Quality 85 is good enough for viewing and takes half
            the space of 95.
        exact_depth: Whether depth is logged without rounding to millimetres, which doubles the
            log's size. With "raw" or "png" colour as well, a replay sees exactly what the run saw.
        images: Whether images are written; otherwise they are discarded at once.
        drop_when_full: Whether a full queue drops messages, and counts them in the metadata
            `dropped_messages`, instead of blocking the caller. True for hardware, where the loop
            must not wait for a disk.
        chunk_size: How much is written at once [bytes, before compression]. If the process is
            killed, the log lacks the chunk that is not full yet.
    """

    color: ColorEncoding = field(default_factory=lambda: ColorEncoding(jpeg_quality=85))
    exact_depth: bool = False
    images: bool = True
    drop_when_full: bool = False
    chunk_size: int = 1 << 20

    @classmethod
    def for_hardware(cls) -> Self:
        """Returns the configuration for a real robot: writes do not block, and chunks are small."""
        return cls(drop_when_full=True, chunk_size=1 << 16)


_BATCH = 48
"""Number of messages handed to the background thread at once: those of about 1/32 s."""

_BATCHES = 42
"""How many batches may wait for the writing thread. Their messages cover more than a second at the
default rates, and take 60 MB including images."""


class RunLogWriter:
    """Writes the log of a run; use it in a `with` block, or call `close`.

    All times are context times of the loop [s]; they start at 0, also on hardware. `time` is when
    a message is logged; `stamp` is when its contents were measured, by default `time`. A write
    copies its arrays and returns. A background thread encodes and compresses them and writes them
    to disk. If that fails, e.g. because the disk is full, a later write or `close` raises an error.

    After `close`, the file is readable, even if there was an exception. The log is also closed when
    the interpreter exits.

    Args:
        path: The MCAP file; its folder is created if needed. An older file is overwritten.
        metadata: Metadata of the run, e.g. {"scenario": "HangMug", "seed": "3"}.
        scenario_text: The scenario as YAML, kept as an attachment.
        plan: The contents of the plan file, kept as an attachment.
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
        self._config, path = config or RunLogConfig(), Path(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        self._sink = McapSink(path.open("wb"), chunk_size=self._config.chunk_size)
        self._encoder = MessageEncoder(
            color=self._config.color, exact_depth=self._config.exact_depth
        )
        self._closed = False
        # Metadata first, so that even a log that was never closed has it.
        self._sink.add_metadata({**version_metadata(), **(metadata or {})})
        if scenario_text is not None:
            self._sink.add_attachment(
                SCENARIO_ATTACHMENT, media_type="application/yaml", data=scenario_text.encode()
            )
        if plan is not None:
            self._sink.add_attachment(PLAN_ATTACHMENT, media_type="application/zip", data=plan)
        self._worker = BackgroundWorker(name="run_log", capacity=_BATCHES, batch=_BATCH)
        atexit.register(self.close)

    def write_calibration(self, camera: CameraModel, *, time: float) -> None:
        """Writes a camera's intrinsics and pose."""
        frame_id = optical_frame(camera.name)
        topic = camera_topic(camera.name, "calibration")
        self._write(topic, self._encoder.calibration, camera, time=time, frame_id=frame_id)
        self.write_transform(camera.X_WC, child=frame_id, time=time)

    def write_image(
        self, camera: str, rgb: np.ndarray, *, time: float, stamp: float | None = None
    ) -> None:
        """Writes an (H, W, 3) uint8 colour image."""
        self._write_pixels("image", camera, rgb, time, stamp)

    def write_depth(
        self, camera: str, depth: np.ndarray, *, time: float, stamp: float | None = None
    ) -> None:
        """Writes an (H, W) depth image [m]."""
        self._write_pixels("depth", camera, depth, time, stamp)

    def write_label(
        self, camera: str, label: np.ndarray, *, time: float, stamp: float | None = None
    ) -> None:
        """Writes an (H, W) int16 label image."""
        self._write_pixels("label", camera, label, time, stamp)

    def write_label_ids(self, label_ids: Mapping[str, Sequence[int]]) -> None:
        """Writes the render labels of objects and parts; see `MultiViewFrame.label_ids`."""
        text = json.dumps({name: list(ids) for name, ids in label_ids.items()})
        self._submit(lambda: self._sink.add_metadata({LABEL_IDS_KEY: text}))

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
        """Writes (N, 3) world points [m], with (N,) confidences if given, to /points/<name>.

        The names in use are tracked, propagated, reference and target. Points are rounded to
        float32 unless `exact`.
        """
        options = {"frame_id": WORLD_FRAME, "confidence": confidence, "exact": exact}
        encode = self._encoder.points
        self._write(f"/points/{name}", encode, points, time=time, stamp=stamp, **options)

    def write_transform(self, X_WC: np.ndarray, *, child: str, time: float) -> None:
        """Writes the (4, 4) pose of frame `child` in the world [m] to /tf."""
        encode = self._encoder.transform
        self._write(TRANSFORM_TOPIC, encode, X_WC, time=time, parent=WORLD_FRAME, child=child)

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
        """Writes the (J,) positions [rad], velocities [rad/s] and torques [N m] of named joints."""
        states: dict[str, Any] = {"position": position, "velocity": velocity, "effort": effort}
        self._write(topic, self._encoder.joint_states, names, time=time, **states)

    def write_twist(self, topic: str, twist: np.ndarray, *, time: float) -> None:
        """Writes a (6,) spatial velocity, (ω [rad/s], v [m/s]) in the world, to `topic`."""
        angular, linear = (
            dict(zip("xyz", part.tolist(), strict=True))
            for part in np.split(np.asarray(twist, dtype=float), 2)
        )
        values = {"angular": angular, "linear": linear}
        self._write_json(topic, values, schema="poil.Twist", time=time)

    def write_status(self, topic: str, values: Mapping[str, Any], *, time: float) -> None:
        """Writes named values to `topic`, e.g. /controller/status, /ik/status, /tracker/status.

        The values may be numbers, strings, arrays and mappings of these. The first message on a
        topic sets its JSON schema, so use the same names in every message on that topic.
        """
        self._write_json(topic, values, schema=f"poil{topic.replace('/', '.')}", time=time)

    def write_phase(self, phase: str, *, time: float, reason: str = "") -> None:
        """Writes the start of a phase of the task to /phase, with its reason."""
        values = {"phase": phase, "reason": reason}
        self._write_json(PHASE_TOPIC, values, schema="poil.phase", time=time)

    def close(self) -> None:
        """Waits for the background thread and finishes the file. A second call does nothing.

        Raises:
            OSError: if the file could not be written; it is closed nevertheless.
        """
        if self._closed:
            return
        self._closed = True
        atexit.unregister(self.close)
        try:
            self._worker.close()
        finally:
            if self._worker.dropped:
                self._sink.add_metadata({"dropped_messages": str(self._worker.dropped)})
            self._sink.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _write_pixels(
        self, kind: str, camera: str, pixels: np.ndarray, time: float, stamp: float | None
    ) -> None:
        if self._config.images:
            topic, encode = camera_topic(camera, kind), partial(self._encoder.image, kind)
            frame_id = optical_frame(camera)
            self._write(topic, encode, pixels, time=time, stamp=stamp, frame_id=frame_id)

    def _write(
        self,
        topic: str,
        encode: Callable[..., EncodedMessage],
        content: Any,
        *,
        time: float,
        stamp: float | None = None,
        **options: Any,
    ) -> None:
        """Queues a message; the background thread encodes it from copies of its arrays."""
        now, captured = to_nanoseconds(time), to_nanoseconds(time if stamp is None else stamp)
        kept = _kept(content)
        options = {name: _kept(value) for name, value in options.items()}
        self._submit(
            lambda: self._sink.write(topic, encode(kept, stamp=captured, **options), time=now)
        )

    def _write_json(
        self, topic: str, values: Mapping[str, Any], *, schema: str, time: float
    ) -> None:
        now = to_nanoseconds(time)
        record = json_record(values, stamp=now)
        self._submit(lambda: self._sink.write_json(topic, record, schema=schema, time=now))

    def _submit(self, job: Callable[[], None]) -> None:
        self._worker.submit(job, may_drop=self._config.drop_when_full)


def _kept(value: Any) -> Any:
    """Returns the value, or a copy if it is an array that may change (writable, or a view)."""
    may_change = isinstance(value, np.ndarray) and (value.flags.writeable or value.base is not None)
    return value.copy() if may_change else value
