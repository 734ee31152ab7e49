"""One trial: the trackers run on the sequences of one seed, in each case."""

import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from poil_drake.benchmarks.tracking.cases import CASES, TrackingCase
from poil_drake.benchmarks.tracking.measures import Track
from poil_drake.benchmarks.tracking.sequence import MakeSequence, TrackingSequence, slip_time
from poil_drake.diagrams.loop.perception import MakeScenarioTracker
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.errors import DetectionError, MissingDependencyError, TrackingError
from poil_drake.geometry.rigid_transform import inverse
from poil_drake.perception.faults.injector import FaultInjector
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.perception.trackers.protocol import Tracker

NO_WEIGHTS = "weights not present"


@dataclass(frozen=True, eq=False)
class TrackedTrial:
    """One tracker in one case on the sequence of one seed.

    Attributes:
        seed: The trial's seed.
        case: Name in `CASES`.
        tracker: Name of the tracker.
        prior: Whether it got the motion of the hand as its prior, as in the closed loop.
        track: What it reported; None if it could not run.
        problem: Why it could not run; empty if it did.
        tiles: Pictures (H, W, 3) uint8 of some frames with the points; only of the first seed.
    """

    seed: int
    case: str
    tracker: str
    prior: bool
    track: Track | None = None
    problem: str = ""
    tiles: tuple[np.ndarray, ...] = ()


def run_trial(
    trackers: Sequence[str],
    cases: Sequence[str],
    priors: Sequence[bool],
    max_frames: int | None,
    data: str | None,
    seed: int,
) -> list[TrackedTrial]:
    """Runs every tracker, with and without a prior, in every case on the sequences of a seed.

    Args:
        trackers: Names of trackers, configured as in the scenario.
        cases: Names in `CASES`.
        priors: Whether the trackers get the motion of the hand.
        max_frames: Frames of each sequence; None for all.
        data: YAML merged over the package's scenario.
        seed: Seed of the sequences and the faults.
    """
    poil = ChooseScenario(data=data).poil
    results = []
    for kind in dict.fromkeys(CASES[name].sequence for name in cases):
        sequence = MakeSequence(kind, seed, max_frames=max_frames, data=data)
        for name in (name for name in cases if CASES[name].sequence == kind):
            for tracker, prior in product(trackers, priors):
                one = TrackedTrial(seed, name, tracker, prior)
                try:
                    with ExitStack() as stack:
                        made = MakeScenarioTracker(replace(poil, tracker=tracker))
                        stack.callback(getattr(made, "close", lambda: None))  # its process, if any
                        track, tiles = follow(made, sequence, CASES[name], prior=prior, seed=seed)
                except MissingDependencyError as error:
                    one = replace(one, problem=f"{NO_WEIGHTS} ({error.problem})")
                except (TrackingError, DetectionError) as error:
                    one = replace(one, problem=error.problem)
                else:
                    one = replace(one, track=track, tiles=tiles if seed == 0 else ())
                results.append(one)
    return results


def follow(
    tracker: Tracker, sequence: TrackingSequence, case: TrackingCase, *, prior: bool, seed: int
) -> tuple[Track, tuple[np.ndarray, ...]]:
    """Runs a tracker on a sequence, as the closed loop would: only frames that are new are tracked.

    A step that raises a TrackingError counts as lost, and the tracker keeps its last state.

    Args:
        tracker: The tracker.
        sequence: The frames without faults, and the truth.
        case: The faults.
        prior: Whether the tracker gets the motion of the hand.
        seed: Seed of random faults.

    Returns:
        The track, and pictures of some frames with the reported points.

    Raises:
        DetectionError: if the first frame hardly shows the part.
        TrackingError: if the tracker cannot start.
    """
    motion = sequence.motion
    start = slip_time(motion)
    names = tuple(camera.name for camera in sequence.frames[0].cameras)
    label = sequence.poil.object
    injector = FaultInjector(case.faults(start, names), object_label=label, seed=seed)
    first_pixels = _pixels(sequence.frames[0], label)
    query = np.zeros((0, 3))
    shown = set(np.linspace(0, len(sequence.frames) - 1, 8).astype(int).tolist())
    rows, tiles, state, last, since = [], [], None, -np.inf, 0
    for index, true in enumerate(sequence.frames):
        frame = injector.apply(true)
        if not frame.stamp > last:
            continue
        visible = np.max(_pixels(frame, label) / np.maximum(first_pixels, 1))
        unlabelled = MultiViewFrame(frame.cameras, frame.images)
        if index == 0:
            query = sequence.query_points(frame)
        began = time.perf_counter()
        try:
            if index == 0:
                output = tracker.start(unlabelled, query, sequence.masks.object_masks)
            else:
                moved = motion.priors[index] @ inverse(motion.priors[since])
                output = tracker.step(state, unlabelled, moved if prior else None)
        except TrackingError:
            if index == 0:
                raise
            points, lost = TrackedPoints.lost(len(query), frame.stamp), True
        else:
            state, points, lost, since = output.state, output.points, output.lost, index
        wall = time.perf_counter() - began
        last = frame.stamp
        errors = np.linalg.norm(points.positions - sequence.moved(query, index), axis=1)
        errors[(points.confidence <= 0.0) | lost] = np.nan
        confidence = 0.0 if lost else points.confidence.max()
        rows.append((motion.times[index], errors, lost, confidence, visible, wall))
        if index in shown:
            tiles.append(_tile(frame, points, lost=lost))
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    track = Track(
        times=columns[0],
        errors=columns[1],
        lost=columns[2],
        confidence=columns[3],
        visible=columns[4],
        wall=columns[5],
        disturbance=None if case.duration is None else (start, start + case.duration),
    )
    return track, tuple(tiles)


def _pixels(frame: MultiViewFrame, name: str) -> np.ndarray:
    """Returns how many pixels of each view (V,) show the object."""
    ids = frame.label_ids[name]
    return np.array([np.isin(i.label, ids).sum() for i in frame.images if i.label is not None])


def _tile(frame: MultiViewFrame, points: TrackedPoints, *, lost: bool) -> np.ndarray:
    """Returns a picture of the views side by side, half as large, with the reported points."""
    import cv2

    views = []
    for camera, image in zip(frame.cameras, frame.images, strict=True):
        picture = image.rgb.copy()
        reported = points.positions[points.confidence > 0.0]
        p = (reported - camera.X_WC[:3, 3]) @ camera.X_WC[:3, :3] @ camera.K.T
        for u, v in np.rint(p[:, :2] / p[:, 2:]).astype(int).tolist():
            cv2.circle(picture, (u, v), 5, (255, 60, 0), -1)
        if lost:
            cv2.putText(picture, "lost", (20, 60), cv2.FONT_HERSHEY_SIMPLEX, 2.0, (255, 0, 0), 4)
        views.append(cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
    return np.concatenate(views)
