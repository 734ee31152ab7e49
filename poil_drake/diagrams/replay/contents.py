"""Checks that a run's log is complete enough to be replayed, and notes what it lacks."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.cameras.cameras import CameraDelay
from poil_drake.errors import RunLogError
from poil_drake.perception.detectors.registry import LABEL_IMAGE
from poil_drake.recording.mcap.library_versions import version_metadata
from poil_drake.recording.run_log.layout import (
    CAMERAS_STATUS_TOPIC,
    DETECTOR_TIMES_TOPIC,
    HAND_STATUS_TOPIC,
    JOINT_COMMANDS_TOPIC,
    JOINT_STATES_TOPIC,
    REPLAY_OF_KEY,
    ROBOT_STATUS_TOPIC,
    SIMULATED,
    STATION_KEY,
    TRACKED_TOPIC,
    TRACKER_TIMES_TOPIC,
)
from poil_drake.recording.run_log.recorded_run import RecordedRun

SPARSE = 1.5
"""A log whose sampling period exceeds this multiple of the control period is sparse."""

_LATEST_START = 4.0
"""Latest time of the first sample [logger periods]. A slow disk may lose the first samples."""

_LONGEST_GAP = 60.0
"""Longest allowed gap between samples [s]. A slow disk leaves shorter gaps."""


class _Topic(NamedTuple):
    """A signal that a replay needs.

    Attributes:
        topic: Topic of the signal.
        what: Name of the signal in errors.
        is_logged: Returns whether a run's log holds the signal.
        is_needed: Returns whether a replay of the run needs the signal.
        images_only: Whether only replays that track the run's images again need the signal.
    """

    topic: str
    what: str
    is_logged: Callable[[RecordedRun], bool]
    is_needed: Callable[[RecordedRun], bool] = lambda run: True
    images_only: bool = False


def _begun(run: RecordedRun) -> bool:
    """Returns whether the skill entered a phase other than waiting and fault."""
    return any(phase.name not in ("wait", "fault") for phase in run.phases)


def _moved(run: RecordedRun) -> bool:
    return bool(np.any(np.nan_to_num(run.commands.values)))


def _tracked(run: RecordedRun) -> bool:
    return _begun(run) or bool(run.tracks)


def _found(run: RecordedRun) -> bool:
    return any(logged.track.confidence.any() for logged in run.tracks)


def _knows(topic: str, column: int) -> Callable[[RecordedRun], bool]:
    return lambda run: bool(np.isfinite(run.numbers[topic].values[:, column]).any())


_TOPICS = (
    _Topic(JOINT_STATES_TOPIC, "joint states", lambda run: len(run.joints) > 0),
    _Topic(JOINT_COMMANDS_TOPIC, "commanded joint velocities", lambda run: len(run.commands) > 0),
    _Topic(
        JOINT_COMMANDS_TOPIC,
        "commanded joint positions",
        lambda run: bool(np.isfinite(run.postures.values).any()),
        _moved,
    ),
    _Topic(ROBOT_STATUS_TOPIC, "robot modes", _knows(ROBOT_STATUS_TOPIC, 0), _begun),
    _Topic(
        HAND_STATUS_TOPIC,
        "hand openings (field width_measured)",
        _knows(HAND_STATUS_TOPIC, 1),
        _begun,
    ),
    _Topic(TRACKED_TOPIC, "tracks", lambda run: bool(run.tracks), _begun),
    _Topic(
        TRACKER_TIMES_TOPIC, "capture times (field begun)", _knows(TRACKER_TIMES_TOPIC, 0), _tracked
    ),
    _Topic(
        DETECTOR_TIMES_TOPIC,
        "capture times (field begun)",
        _knows(DETECTOR_TIMES_TOPIC, 0),
        _found,
        images_only=True,
    ),
)


def RequireTopics(run: RecordedRun, *, repeat_tracks: bool) -> None:
    """Checks that a log holds all signals that a replay needs.

    Args:
        run: The run.
        repeat_tracks: Whether the replay repeats the run's tracks instead of tracking its images.

    Raises:
        RunLogError: naming a missing signal and its topic.
    """
    for one in _TOPICS:
        if one.is_logged(run) or not one.is_needed(run) or (one.images_only and repeat_tracks):
            continue
        raise lacking_error(
            run, f"{one.what} on the topic {one.topic}", images_only=one.images_only
        )


def RequireTimes(run: RecordedRun, scenario: Scenario) -> None:
    """Checks that a log's joint states begin at time 0 and have no long gaps.

    Args:
        run: The run.
        scenario: The run's scenario, which sets the logger's period.

    Raises:
        RunLogError: if the joint states begin later or have a long gap.
    """
    times = run.joints.times
    edges = np.append(min(0.0, times[0]), times)
    allowed = np.full(len(times), _LONGEST_GAP)
    allowed[0] = _LATEST_START * scenario.poil.rates.logger
    gaps = np.flatnonzero(np.diff(edges) > allowed)
    if gaps.size:
        k = int(gaps[0])
        raise RunLogError(
            f"The samples on the topic {JOINT_STATES_TOPIC} in '{run.path}' range from "
            f"{times[0]:.6g} s to {times[-1]:.6g} s, with none between {edges[k]:.6g} s and "
            f"{times[k]:.6g} s. A run begins at time 0 and has no such gap.",
            remedy="Replay the run's whole log, with its original times.",
        )


def RequireImages(run: RecordedRun, scenario: Scenario) -> None:
    """Checks that a log holds the images that the detector and the tracker need.

    Args:
        run: The run.
        scenario: Names the cameras and the detector.

    Raises:
        RunLogError: if a camera has no images, or lacks label images that the detector needs.
    """
    for camera in scenario.cameras:
        images = run.images.get(camera, [])
        labelled = any(image.label is not None for image in images)
        kind = "" if not images else "label "
        if not images or (scenario.poil.detector == LABEL_IMAGE and not labelled):
            raise RunLogError(
                f"The log '{run.path}' holds no {kind}images of the camera '{camera}'.",
                remedy="Repeat the run's tracks with --tracker recorded.",
            )


def IsSparse(run: RecordedRun, scenario: Scenario) -> bool:
    """Returns whether a log lacks samples of the robot's signals in some control periods."""
    return run.joints.period > SPARSE * scenario.poil.rates.control


def NotesOn(run: RecordedRun, scenario: Scenario, *, repeat_tracks: bool) -> tuple[str, ...]:
    """Returns remarks on a log, one clause each.

    Args:
        run: The run.
        scenario: The run's scenario.
        repeat_tracks: Whether the replay repeats the run's tracks instead of tracking its images.
    """
    notes = []
    if original := run.metadata.get(REPLAY_OF_KEY):
        notes.append(f"this is the log of a replay of {original}, not of a run")
    if run.cut_off:
        notes.append(f"the log is cut off: its last sample is at {run.end:.2f} s")
    if IsSparse(run, scenario):
        notes.append(
            f"the robot's signals were logged only every {run.joints.period:g} s, and the replay "
            "holds each sample until the next"
        )
    if dropped := run.metadata.get("dropped_messages"):
        notes.append(f"the log lacks {dropped} messages because the disk was too slow")
    simulated = run.metadata.get(STATION_KEY, SIMULATED) == SIMULATED
    if not simulated and not _knows(ROBOT_STATUS_TOPIC, 3)(run):
        notes.append(
            f"the log lacks the times of the run's clock ({ROBOT_STATUS_TOPIC}), so the replay "
            "does not show stalls of the process"
        )
    momentary = simulated and CameraDelay(scenario.cameras) == 0.0
    if not repeat_tracks and not momentary and not run.camera_times:
        notes.append(
            f"the log lacks {CAMERAS_STATUS_TOPIC}, so the times of images that perception did not "
            "use are unknown"
        )
    versions = version_metadata()
    for key in ("poil_drake_version", "drake_version"):
        written = run.metadata.get(key, "")
        if written and written != versions.get(key):
            name = key.removesuffix("_version")
            notes.append(
                f"the log was written with {name} {written} and replayed with {versions.get(key)}"
            )
    return tuple(notes)


def lacking_error(run: RecordedRun, what: str, *, images_only: bool = False) -> RunLogError:
    """Returns the error for a log that lacks what a replay needs."""
    cause = run.cut_off or "The log may come from an older version or another program"
    remedy = "Replay a complete log, written by this version of poil run or poil execute"
    if images_only:
        remedy += ", or repeat the run's tracks with --tracker recorded"
    return RunLogError(f"The log '{run.path}' holds no {what}. {cause}.", remedy=f"{remedy}.")
