"""Reads the log of a run in one pass, without decoding its images."""

import json
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from mcap.records import Attachment
from mcap.well_known import MessageEncoding

from poil_drake.errors import DemonstrationError, InvalidValueError, PoilError, RunLogError
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.recording.demonstration.contents import CameraContents, Contents
from poil_drake.recording.demonstration.layout import WORLD_FRAME, optical_frame
from poil_drake.recording.demonstration.stored_images import StoredImages
from poil_drake.recording.mcap.message_decoders import decode_joint_states, decode_points
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
    LoggedTrack,
    PhaseStart,
    RecordedRun,
    Series,
)
from poil_drake.robots.panda import ARM_JOINTS

NUMBERS = {
    # Topic: the names of the numbers in its records.
    ROBOT_STATUS_TOPIC: ("mode", "age", "success_rate", "clock"),
    HAND_STATUS_TOPIC: ("width_commanded", "width_measured"),
    TRACKER_STATUS_TOPIC: ("status",),
    TRACKER_TIMES_TOPIC: ("begun", "released", "released_of", "status"),
    DETECTOR_TIMES_TOPIC: ("begun", "released", "released_of"),
    STOPS_TOPIC: ("requests",),
}

_IMAGE_TIME = ".image_time"
"""In records of CAMERAS_STATUS_TOPIC, `<camera>.image_time` is the time of the newest image."""

# Raised on reading a message that does not suit its topic; InvalidValueError is a ValueError.
_MESSAGE_ERRORS = (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError)


def load_recorded_run(path: str | Path, *, joint_names: Sequence[str] = ARM_JOINTS) -> RecordedRun:
    """Reads the log of a run. If it is cut off, reads what is left and sets `RecordedRun.cut_off`.

    Args:
        path: The MCAP file.
        joint_names: Names of the arm's joints; by default the Panda's.

    Raises:
        RunLogError: if the file is missing or damaged, or a message does not have the type or the
            fields that a run log has on the message's topic.
    """
    return _Reader(Path(path), tuple(joint_names)).read()


class _Reader:
    """Collects the contents of a log into a `RecordedRun`."""

    def __init__(self, path: Path, joint_names: tuple[str, ...]):
        self._run = RecordedRun(path, joint_names)
        self._contents = Contents()
        self._samples: dict[str, list[tuple[float, Any]]] = defaultdict(list)
        self._image_times: dict[str, list[tuple[float, Any]]] = defaultdict(list)
        self._add: dict[str, Callable[[ScannedMessage, float], None]] = {
            TRACKED_TOPIC: self._add_track,
            CAMERAS_STATUS_TOPIC: self._add_image_times,
            PHASE_TOPIC: self._add_phase,
            JOINT_STATES_TOPIC: self._add_joint_states,
            JOINT_COMMANDS_TOPIC: self._add_joint_states,
            TWIST_TOPIC: self._add_twist,
            **dict.fromkeys(NUMBERS, self._add_numbers),
        }

    def read(self) -> RecordedRun:
        run = self._run
        try:
            for item in scan(run.path):
                if isinstance(item, ScannedMessage):
                    self._add_message(item)
                elif isinstance(item, Attachment) and item.name == PLAN_ATTACHMENT:
                    run.plan = item.data
                else:
                    self._contents.add(item)
        except CutOffError as error:
            run.cut_off = error.problem.rstrip(".")
        except DemonstrationError as error:
            raise RunLogError(error.problem, remedy=REMEDY) from error
        self._finish()
        return run

    def _finish(self) -> None:
        """Stores the collected samples in the run, sorted by time."""
        run, samples, count = self._run, self._samples, len(self._run.joint_names)
        run.joints = Series.of(samples[JOINT_STATES_TOPIC], 3 * count)
        commands = Series.of(samples[JOINT_COMMANDS_TOPIC], 3 * count)
        run.postures = Series(commands.times, commands.values[:, :count])
        run.commands = Series(commands.times, commands.values[:, count : 2 * count])
        run.twist = Series.of(samples[TWIST_TOPIC], 6)
        run.numbers = {topic: Series.of(samples[topic], len(NUMBERS[topic])) for topic in NUMBERS}
        run.camera_times = {
            camera: Series.of(times, 1) for camera, times in sorted(self._image_times.items())
        }
        run.phases.sort(key=lambda phase: phase.time)
        run.tracks.sort(key=lambda logged: logged.track.stamp)
        contents = self._contents
        run.metadata, run.scenario_text = contents.metadata, contents.scenario_text
        for name, camera in contents.cameras.items():
            run.images[name] = _with_depth(camera)
            if camera.calibration:
                run.calibrations[name] = camera.calibration[0][1]
            frames, frame = contents.frames, optical_frame(name)
            if frames.connected(base=WORLD_FRAME, frame=frame):
                run.camera_poses[name] = frames.pose(base=WORLD_FRAME, frame=frame, stamp=0)

    def _add_message(self, scanned: ScannedMessage) -> None:
        """Adds a message; ignores topics that no replay needs.

        Raises:
            RunLogError: if the message is damaged, or has the wrong type for its topic.
        """
        try:
            if add := self._add.get(scanned.topic):
                add(scanned, to_seconds(scanned.log_time))
            else:
                self._contents.add(scanned)
        except _MESSAGE_ERRORS as error:
            damage = f"a message is damaged: {error!r}."
            problem = error.problem if isinstance(error, PoilError) else damage
            raise RunLogError(
                f"{self._run.path}, topic {scanned.topic}: {problem}", remedy=REMEDY
            ) from error

    def _add_joint_states(self, scanned: ScannedMessage, time: float) -> None:
        values = decode_joint_states(scanned.decode(JointStates), self._run.joint_names)
        self._samples[scanned.topic].append((time, values.ravel()))

    def _add_track(self, scanned: ScannedMessage, time: float) -> None:
        message = scanned.decode(PointCloud)
        stamp = to_seconds(get_timestamp(message, default=scanned.log_time))
        self._run.tracks.append(LoggedTrack(time, TrackedPoints(*decode_points(message), stamp)))

    def _add_twist(self, scanned: ScannedMessage, time: float) -> None:
        record = _record(scanned)
        values = [_number(record[part][axis]) for part in ("angular", "linear") for axis in "xyz"]
        self._samples[scanned.topic].append((time, values))

    def _add_numbers(self, scanned: ScannedMessage, time: float) -> None:
        record = _record(scanned)
        values = [_number(record.get(key)) for key in NUMBERS[scanned.topic]]
        self._samples[scanned.topic].append((time, values))

    def _add_image_times(self, scanned: ScannedMessage, time: float) -> None:
        for key, value in _record(scanned).items():
            if key.endswith(_IMAGE_TIME):
                camera = key.removesuffix(_IMAGE_TIME)
                self._image_times[camera].append((time, [_number(value)]))

    def _add_phase(self, scanned: ScannedMessage, time: float) -> None:
        record = _record(scanned)
        self._run.phases.append(PhaseStart(time, str(record["phase"]), str(record["reason"])))


def _with_depth(camera: CameraContents) -> list[StoredImages]:
    """Returns the colour images that have a depth image, each with its label image, if any."""
    depth, label = (
        {image.stamp: image for image in stream} for stream in (camera.depth, camera.label)
    )
    return [
        StoredImages(image, depth[image.stamp], label.get(image.stamp))
        for image in sorted(camera.image, key=lambda image: image.log_time)
        if image.stamp in depth
    ]


def _record(scanned: ScannedMessage) -> Mapping[str, Any]:
    record = json.loads(scanned.data)
    if scanned.encoding != MessageEncoding.JSON or not isinstance(record, dict):
        raise InvalidValueError("a message is not a JSON object.", remedy=REMEDY)
    return record


def _number(value: Any) -> float:
    """Returns a record's value as a float. Null stands for NaN and infinity, and becomes NaN."""
    if value is None:
        return np.nan
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InvalidValueError(f"a record holds {value!r} instead of a number.", remedy=REMEDY)
    return float(value)
