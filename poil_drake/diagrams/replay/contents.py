"""Checks that a run's log is complete enough to be replayed, and remarks on what it lacks."""

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
    PLAN_ATTACHMENT,
    REPLAY_OF_KEY,
    ROBOT_STATUS_TOPIC,
    SIMULATED,
    STATION_KEY,
    TRACKED_TOPIC,
    TRACKER_TIMES_TOPIC,
)
from poil_drake.recording.run_log.recorded_run import RecordedRun

SPARSE = 1.5
"""Logs with a period longer than this multiple of the control period miss samples."""

_LATEST_START = 4.0
"""Latest time of the first sample, in periods of the logger: a slow disk may lose the first few."""

_LONGEST_GAP = 60.0
"""Longest gap between samples [s]; no disk is that slow, and a replay simulates every gap."""


class _Topic(NamedTuple):
    """A signal that a replay needs.

    Attributes:
        topic: The topic.
        what: Name of the signal.
        is_logged: Whether the log has it.
        is_needed: Whether this run's replay needs it.
        images_only: Whether it is needed only where images are tracked again.
    """

    topic: str
    what: str
    is_logged: Callable[[RecordedRun], bool]
    is_needed: Callable[[RecordedRun], bool] = lambda run: True
    images_only: bool = False


def _begun(run: RecordedRun) -> bool:
    """Whether the skill went on because robot and points were known."""
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
    _Topic(JOINT_COMMANDS_TOPIC, "joint velocities", lambda run: len(run.commands) > 0),
    _Topic(
        JOINT_COMMANDS_TOPIC,
        "joint positions",
        lambda run: bool(np.isfinite(run.postures.values).any()),
        _moved,
    ),
    _Topic(ROBOT_STATUS_TOPIC, "modes", _knows(ROBOT_STATUS_TOPIC, 0), _begun),
    _Topic(HAND_STATUS_TOPIC, "openings ('width_measured')", _knows(HAND_STATUS_TOPIC, 1), _begun),
    _Topic(TRACKED_TOPIC, "tracks", lambda run: bool(run.tracks), _begun),
    _Topic(
        TRACKER_TIMES_TOPIC, "times of frames ('begun')", _knows(TRACKER_TIMES_TOPIC, 0), _tracked
    ),
    _Topic(
        DETECTOR_TIMES_TOPIC,
        "times of searches ('begun')",
        _knows(DETECTOR_TIMES_TOPIC, 0),
        _found,
        images_only=True,
    ),
)


def RequireAttachments(run: RecordedRun) -> None:
    """Checks that a log holds scenario and plan.

    Raises:
        RunLogError: if it does not.
    """
    for what, lacks in (
        ("scenario", run.scenario_text is None),
        (f"plan (the attachment '{PLAN_ATTACHMENT}')", run.plan is None),
    ):
        if lacks:
            raise _lacking(run, what)


def RequireTopics(run: RecordedRun, *, repeat_tracks: bool) -> None:
    """Checks that a log holds the signals without which a replay would not move.

    Args:
        run: The run.
        repeat_tracks: Whether its tracks are repeated, so that images are not needed.

    Raises:
        RunLogError: if one is missing, with its topic.
    """
    for one in _TOPICS:
        if one.is_logged(run) or not one.is_needed(run) or (one.images_only and repeat_tracks):
            continue
        raise _lacking(run, f"{one.what} in the topic {one.topic}", images_only=one.images_only)


def RequireTimes(run: RecordedRun, scenario: Scenario) -> None:
    """Checks that a log begins at the time 0 and has no long gap.

    Args:
        run: The run.
        scenario: Its periods.

    Raises:
        RunLogError: if it begins later, or has a gap.
    """
    times = run.joints.times
    edges = np.append(min(0.0, times[0]), times)
    allowed = np.full(len(times), _LONGEST_GAP)
    allowed[0] = _LATEST_START * scenario.poil.rates.logger
    gaps = np.flatnonzero(np.diff(edges) > allowed)
    if gaps.size:
        k = int(gaps[0])
        raise RunLogError(
            f"The samples of the topic {JOINT_STATES_TOPIC} in '{run.path}' go from {times[0]:.6g} "
            f"s to {times[-1]:.6g} s, without any between {edges[k]:.6g} s and {times[k]:.6g} s.",
            remedy="A run begins at the time 0 and has no such gap: replay its whole log, with the "
            "times that poil run wrote.",
        )


def RequireImages(run: RecordedRun, scenario: Scenario, *, remedy: str) -> None:
    """Checks that a log has the images for detector and tracker.

    Args:
        run: The run.
        scenario: Names the cameras and the detector.
        remedy: The advice if there are none.

    Raises:
        RunLogError: if it has no images of a camera, or no label images that are needed.
    """
    for camera in scenario.cameras:
        images = run.images.get(camera, [])
        labelled = any(image.label is not None for image in images)
        kind = "" if not images else "label "
        if not images or (scenario.poil.detector == LABEL_IMAGE and not labelled):
            raise RunLogError(
                f"The log '{run.path}' holds no {kind}images of the camera '{camera}'.",
                remedy=remedy,
            )


def IsSparse(run: RecordedRun, scenario: Scenario) -> bool:
    """Returns whether a log misses samples of the robot's signals."""
    return run.joints.period > SPARSE * scenario.poil.rates.control


def NotesOn(run: RecordedRun, scenario: Scenario, *, repeat_tracks: bool) -> tuple[str, ...]:
    """Returns remarks on a log, a clause each.

    Args:
        run: The run.
        scenario: The run's scenario.
        repeat_tracks: Whether its tracks are repeated, so that images are not needed.
    """
    notes = []
    if original := run.metadata.get(REPLAY_OF_KEY):
        notes.append(f"this is the log of a replay of {original}, not of a run")
    if run.cut_off:
        notes.append(f"the log is cut off, its last sample is of {run.end:.2f} s")
    if IsSparse(run, scenario):
        notes.append(
            f"the robot's signals were logged every {run.joints.period:g} s only, and are held in "
            "between"
        )
    if dropped := run.metadata.get("dropped_messages"):
        notes.append(f"the log lacks {dropped} messages, as its disk was too slow")
    simulated = run.metadata.get(STATION_KEY, SIMULATED) == SIMULATED
    if not simulated and not _knows(ROBOT_STATUS_TOPIC, 3)(run):
        notes.append(
            f"the log lacks the time by the clock (in {ROBOT_STATUS_TOPIC}), so that a process "
            "that was held up does not show"
        )
    momentary = simulated and CameraDelay(scenario.cameras) == 0.0
    if not repeat_tracks and not momentary and not run.camera_times:
        notes.append(
            f"the log lacks {CAMERAS_STATUS_TOPIC}: the times of images that were not used are not "
            "known"
        )
    versions = version_metadata()
    for key in ("poil_drake_version", "drake_version"):
        written = run.metadata.get(key, "")
        if written and written != versions.get(key):
            name = key.removesuffix("_version")
            notes.append(f"written with {name} {written}, replayed with {versions.get(key)}")
    return tuple(notes)


def _lacking(run: RecordedRun, what: str, *, images_only: bool = False) -> RunLogError:
    why = run.cut_off or "An older version wrote it, or something else than poil run"
    remedy = f"{why}. Replay a log that poil run or poil execute writes"
    if images_only:
        remedy += ", or repeat the run's own tracks: --tracker recorded"
    return RunLogError(f"The log '{run.path}' holds no {what}.", remedy=f"{remedy}.")
