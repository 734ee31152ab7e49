"""Reads the log of a run in one pass, without decoding its images."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.message import DecodeError
from mcap.records import Attachment, Metadata
from mcap.well_known import MessageEncoding

from poil_drake.errors import DemonstrationError, InvalidValueError, PoilError, RunLogError
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.recording.demonstration.contents import StoredImage
from poil_drake.recording.demonstration.layout import (
    CAMERA_TOPIC,
    METADATA_RECORD,
    SCENARIO_ATTACHMENT,
    TRANSFORM_TOPIC,
    WORLD_FRAME,
    optical_frame,
)
from poil_drake.recording.mcap.camera_messages import decode_calibration, decode_transform
from poil_drake.recording.mcap.log_messages import decode_joint_states, decode_points
from poil_drake.recording.mcap.scan import CutOffError, ScannedMessage, scan
from poil_drake.recording.mcap.timestamps import get_timestamp, to_seconds
from poil_drake.recording.run_log.layout import (
    CAMERAS_STATUS_TOPIC,
    DETECTOR_TIMES_TOPIC,
    HAND_STATUS_TOPIC,
    JOINT_COMMANDS_TOPIC,
    JOINT_STATES_TOPIC,
    PHASE_TOPIC,
    PLAN_ATTACHMENT,
    ROBOT_STATUS_TOPIC,
    STOPS_TOPIC,
    TRACKED_TOPIC,
    TRACKER_STATUS_TOPIC,
    TRACKER_TIMES_TOPIC,
    TWIST_TOPIC,
)
from poil_drake.recording.run_log.recorded_run import (
    REMEDY,
    LoggedImages,
    LoggedTrack,
    PhaseStart,
    RecordedRun,
)
from poil_drake.recording.run_log.series import Series

NUMBERS = {
    # Topic                 the numbers that its records hold
    ROBOT_STATUS_TOPIC: ("mode", "age", "success_rate", "clock"),
    HAND_STATUS_TOPIC: ("width_commanded", "width_measured"),
    TRACKER_STATUS_TOPIC: ("status",),
    TRACKER_TIMES_TOPIC: ("begun", "released", "released_of", "status"),
    DETECTOR_TIMES_TOPIC: ("begun", "released", "released_of"),
    STOPS_TOPIC: ("requests",),
}

_IMAGES = ("image", "depth", "label")

# What reading messages raises that are not what their topic holds; InvalidValueError is among them.
_DAMAGE = (DecodeError, ValueError, KeyError, TypeError, AttributeError, OverflowError)


def load_recorded_run(path: str | Path, *, joint_names: Sequence[str]) -> RecordedRun:
    """Reads the log of a run. Of one that is cut off it returns what there is, and says so.

    Args:
        path: The MCAP file.
        joint_names: The arm's joints.

    Raises:
        RunLogError: if the file is missing or damaged, or holds what no run log does.
    """
    path = Path(path)
    run = RecordedRun(path, tuple(joint_names))
    samples = _Samples()
    try:
        for item in scan(path):
            if isinstance(item, Metadata):
                run.metadata |= item.metadata if item.name == METADATA_RECORD else {}
            elif isinstance(item, Attachment):
                _take_attachment(run, item)
            else:
                _take(run, samples, item)
    except CutOffError as error:
        run.cut_off = error.problem.rstrip(".")
    except DemonstrationError as error:
        raise RunLogError(error.problem, remedy=REMEDY) from error
    samples.fill(run)
    return run


@dataclass
class _Samples:
    """What is collected on the way through a file."""

    by_topic: dict[str, list[tuple[float, Any]]] = field(default_factory=dict)
    depth: dict[tuple[str, int], StoredImage] = field(default_factory=dict)
    label: dict[tuple[str, int], StoredImage] = field(default_factory=dict)

    def add(self, topic: str, time: float, value: Any) -> None:
        self.by_topic.setdefault(topic, []).append((time, value))

    def series(self, topic: str, size: int) -> Series:
        return Series.of(self.by_topic.get(topic, []), size)

    def fill(self, run: RecordedRun) -> None:
        count = len(run.joint_names)
        run.joints = self.series(JOINT_STATES_TOPIC, 3 * count)
        commands = self.series(JOINT_COMMANDS_TOPIC, 2 * count)
        run.postures = Series(commands.times, commands.values[:, :count])
        run.commands = Series(commands.times, commands.values[:, count:])
        run.twist = self.series(TWIST_TOPIC, 6)
        run.numbers = {topic: self.series(topic, len(keys)) for topic, keys in NUMBERS.items()}
        for time, seen in self.by_topic.get(CAMERAS_STATUS_TOPIC, []):
            for camera, stamp in seen.items():
                self.add(f"time of {camera}", time, [stamp])
        cameras = {c for _, seen in self.by_topic.get(CAMERAS_STATUS_TOPIC, []) for c in seen}
        run.camera_times = {c: self.series(f"time of {c}", 1) for c in sorted(cameras)}
        run.phases.sort(key=lambda phase: phase.time)
        run.tracks.sort(key=lambda logged: logged.track.stamp)
        for camera, images in run.images.items():
            for image in images:
                image.depth = self.depth.get((camera, image.color.stamp))
                image.label = self.label.get((camera, image.color.stamp))
            images.sort(key=lambda image: image.time)


def _take_attachment(run: RecordedRun, attachment: Attachment) -> None:
    if attachment.name == SCENARIO_ATTACHMENT:
        run.scenario_text = attachment.data.decode(errors="replace")
    elif attachment.name == PLAN_ATTACHMENT:
        run.plan = attachment.data


def _take(run: RecordedRun, samples: _Samples, scanned: ScannedMessage) -> None:
    """Adds a message; topics that no replay needs are passed over.

    Raises:
        RunLogError: if it is damaged, or not of the kind that its topic holds.
    """
    try:
        match = CAMERA_TOPIC.fullmatch(scanned.topic)
        if match is not None:
            if match["kind"] in _IMAGES:
                _take_image(run, samples, scanned, match["camera"], match["kind"])
            else:
                message, _ = _message(scanned, CameraCalibration)
                run.calibrations.setdefault(match["camera"], decode_calibration(message))
        elif scanned.topic in _TAKERS:
            _TAKERS[scanned.topic](run, samples, scanned)
    except _DAMAGE as e:
        problem = e.problem if isinstance(e, PoilError) else f"a message is damaged: {e!r}."
        raise RunLogError(f"{run.path}, topic {scanned.topic}: {problem}", remedy=REMEDY) from e
    except RecursionError as e:
        raise RunLogError(
            f"{run.path}, topic {scanned.topic}: a message is nested too deeply.", remedy=REMEDY
        ) from e


def _take_image(
    run: RecordedRun, samples: _Samples, scanned: ScannedMessage, camera: str, kind: str
) -> None:
    message, message_type = _message(scanned, CompressedImage, RawImage)
    stamp = get_timestamp(message, default=scanned.log_time)
    stored = StoredImage(stamp, message.frame_id, message_type, scanned.location)
    if kind == "image":
        logged = LoggedImages(to_seconds(scanned.log_time), stored)
        run.images.setdefault(camera, []).append(logged)
    else:
        (samples.depth if kind == "depth" else samples.label)[camera, stamp] = stored


def _message(scanned: ScannedMessage, *kinds: Any) -> tuple[Any, Any]:
    """Returns a message, and of which of some kinds it is."""
    for kind in kinds:
        if (scanned.schema, scanned.encoding) == (
            kind.DESCRIPTOR.full_name,
            MessageEncoding.Protobuf,
        ):
            return kind.FromString(scanned.data), kind
    raise InvalidValueError(
        f"it holds '{scanned.schema}' messages encoded as '{scanned.encoding}'.", remedy=REMEDY
    )


def _record(scanned: ScannedMessage) -> Mapping[str, Any]:
    record = json.loads(scanned.data)
    if scanned.encoding != MessageEncoding.JSON or not isinstance(record, dict):
        raise InvalidValueError("it holds something else than JSON records.", remedy=REMEDY)
    return record


def _number(value: Any) -> float:
    """Returns a number of a record; null stands for what is not finite."""
    if value is None:
        return np.nan
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InvalidValueError(f"a record holds {value!r} for a number.", remedy=REMEDY)
    return float(value)


def _take_joint_states(run: RecordedRun, samples: _Samples, scanned: ScannedMessage) -> None:
    message, _ = _message(scanned, JointStates)
    values = decode_joint_states(message, run.joint_names).ravel()
    samples.add(scanned.topic, to_seconds(scanned.log_time), values)


def _take_commands(run: RecordedRun, samples: _Samples, scanned: ScannedMessage) -> None:
    message, _ = _message(scanned, JointStates)
    values = decode_joint_states(message, run.joint_names)[:2].ravel()
    samples.add(scanned.topic, to_seconds(scanned.log_time), values)


def _take_track(run: RecordedRun, samples: _Samples, scanned: ScannedMessage) -> None:
    message, _ = _message(scanned, PointCloud)
    positions, confidence = decode_points(message)
    stamp = to_seconds(get_timestamp(message, default=scanned.log_time))
    track = TrackedPoints(positions, confidence, stamp)
    run.tracks.append(LoggedTrack(to_seconds(scanned.log_time), track))


def _take_twist(run: RecordedRun, samples: _Samples, scanned: ScannedMessage) -> None:
    record = _record(scanned)
    values = [_number(record[part][axis]) for part in ("angular", "linear") for axis in "xyz"]
    samples.add(scanned.topic, to_seconds(scanned.log_time), values)


def _take_numbers(run: RecordedRun, samples: _Samples, scanned: ScannedMessage) -> None:
    record = _record(scanned)
    values = [_number(record.get(key)) for key in NUMBERS[scanned.topic]]
    samples.add(scanned.topic, to_seconds(scanned.log_time), values)


def _take_camera_times(run: RecordedRun, samples: _Samples, scanned: ScannedMessage) -> None:
    ending = ".image_time"
    seen = {
        key.removesuffix(ending): _number(value)
        for key, value in _record(scanned).items()
        if key.endswith(ending)
    }
    samples.add(scanned.topic, to_seconds(scanned.log_time), seen)


def _take_transform(run: RecordedRun, samples: _Samples, scanned: ScannedMessage) -> None:
    message, _ = _message(scanned, FrameTransform)
    child = message.child_frame_id
    if message.parent_frame_id == WORLD_FRAME and child.endswith(optical_frame("")):
        run.camera_poses.setdefault(
            child.removesuffix(optical_frame("")), decode_transform(message)
        )


def _take_phase(run: RecordedRun, samples: _Samples, scanned: ScannedMessage) -> None:
    record = _record(scanned)
    time = to_seconds(scanned.log_time)
    run.phases.append(PhaseStart(time, str(record["phase"]), str(record["reason"])))


_TAKERS = {
    JOINT_STATES_TOPIC: _take_joint_states,
    JOINT_COMMANDS_TOPIC: _take_commands,
    TRACKED_TOPIC: _take_track,
    TWIST_TOPIC: _take_twist,
    CAMERAS_STATUS_TOPIC: _take_camera_times,
    PHASE_TOPIC: _take_phase,
    TRANSFORM_TOPIC: _take_transform,
    **dict.fromkeys(NUMBERS, _take_numbers),
}
