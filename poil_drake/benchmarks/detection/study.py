"""Runs detectors on random scenes and judges what they find."""

import tempfile
from collections import Counter
from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from time import perf_counter

import numpy as np
from tqdm import tqdm

from poil_drake.benchmarks.detection.scenes import DetectionScene, MakeDetectionScene
from poil_drake.benchmarks.trials.pool import LostTrial, run_trials
from poil_drake.diagrams.demonstration.recorder import RecordDemonstration
from poil_drake.diagrams.loop.perception import MakeScenarioTracker
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.errors import DetectionError
from poil_drake.geometry.depth_image import unproject
from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.perception.detectors.known_shape.detector import KnownShapeDetector
from poil_drake.perception.detectors.label_image import LabelImageDetector
from poil_drake.perception.detectors.protocol import Detector
from poil_drake.perception.detectors.registry import DEMONSTRATION, LABEL_IMAGE
from poil_drake.perception.images import MultiViewFrame
from poil_drake.recording.demonstration.demonstration import load_demonstration
from poil_drake.recording.mcap.plain_json import write_json
from poil_drake.reports.progress import OneLineTqdm
from poil_drake.transfer.demonstrated_object import find_demonstrated_object

_RIGHT = 0.01  # largest distance between centroids of the part, as found and as it is seen [m]
_LEAST_PIXELS = 60  # with fewer pixels of the part in all views, a refusal is due

_SCENES_PER_WORKER = 20  # the renderers of many scenes fill the memory

VERDICTS = ("right", "rightly refused", "refused", "wrong")


@dataclass(frozen=True, kw_only=True)
class Detection:
    """The result of one detector in one scene.

    Attributes:
        detector: Name of the detector.
        seed: The scene's seed.
        mug: Name of the mug's model.
        lying: Whether the mug lies on its side.
        clutter: The other objects.
        part_pixels: Number of pixels that show the handle.
        verdict: One of `VERDICTS`. "refused" is a refusal though the part is seen.
        error: Distance between the part's centroids, as found and as seen [m]; NaN if refused.
        reason: Why it was refused.
        seconds: Duration [s].
    """

    detector: str
    seed: int
    mug: str
    lying: bool
    clutter: tuple[str, ...]
    part_pixels: int
    verdict: str
    error: float
    reason: str
    seconds: float


def run_detection_benchmark(
    *, scenes: int, first_seed: int, hidden: bool, jobs: int, json_path: Path
) -> list[Detection]:
    """Runs the detectors on random scenes, prints a table, and writes all results as JSON.

    Args:
        scenes: Number of scenes.
        first_seed: Seed of the first scene.
        hidden: Whether the handle is hidden from all views.
        jobs: Number of scenes that are judged at the same time.
        json_path: JSON file for the results, written after every scene.
    """
    arguments = [(seed, hidden) for seed in range(first_seed, first_seed + scenes)]
    results: list[Detection] = []
    ends = run_trials(
        judge_scene,
        arguments,
        shared=(_recorded_demonstration(),),
        jobs=jobs,
        trials_per_worker=_SCENES_PER_WORKER,
    )
    with closing(ends), OneLineTqdm(total=scenes, desc="scenes") as bar:
        for _, end in ends:
            if isinstance(end, LostTrial):
                tqdm.write(str(end))
            else:
                results += end
                tqdm.write("\n".join(map(_row, end)))
            bar.update()
            results.sort(key=lambda one: (one.detector, one.seed))
            found = [asdict(one) for one in results]
            write_json({"summary": summarize(results), "scenes": found}, json_path)
    print(_table(results))
    return results


def judge_scene(demonstration: bytes, seed: int, hidden: bool) -> list[Detection]:
    """Returns what each detector finds in one scene, given a demonstration file's contents."""
    scene = MakeDetectionScene(seed, hidden=hidden)
    detectors: dict[str, Detector] = {
        DEMONSTRATION: _demonstration_detector(demonstration),
        LABEL_IMAGE: LabelImageDetector(),
    }
    return [judge_detector(name, detector, scene, seed) for name, detector in detectors.items()]


def judge_detector(name: str, detector: Detector, scene: DetectionScene, seed: int) -> Detection:
    """Returns what a detector finds in one scene."""
    error, reason, start = np.nan, "", perf_counter()
    try:
        found = detector.detect(scene.frame, object_label="mug", part_label="handle")
    except DetectionError as refusal:
        reason = refusal.problem
        verdict = "refused" if scene.part_pixels() >= _LEAST_PIXELS else "rightly refused"
    else:
        error = _distance(scene.frame, found.part_masks, scene.part_masks())
        verdict = "right" if error < _RIGHT else "wrong"
    return Detection(
        detector=name,
        seed=seed,
        mug=scene.mug,
        lying=scene.lying,
        clutter=scene.clutter,
        part_pixels=scene.part_pixels(),
        verdict=verdict,
        error=error,
        reason=reason,
        seconds=perf_counter() - start,
    )


def _distance(
    frame: MultiViewFrame, first: Sequence[np.ndarray], second: Sequence[np.ndarray]
) -> float:
    """Returns the distance between the centroids of what masks show [m]; inf if one is empty."""
    centers = []
    for masks in (first, second):
        points = [
            transform_points(camera.X_WC, unproject(image.depth, camera.K, mask)[0])
            for camera, image, mask in zip(frame.cameras, frame.images, masks, strict=True)
        ]
        if not sum(map(len, points)):
            return np.inf
        centers.append(np.concatenate(points).mean(axis=0))
    return float(np.linalg.norm(centers[0] - centers[1]))


@cache
def _demonstration_detector(demonstration: bytes) -> KnownShapeDetector:
    poil = ChooseScenario().poil
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "demo.mcap"
        path.write_bytes(demonstration)
        shown = find_demonstrated_object(
            load_demonstration(path),
            table_height=poil.table_height,
            tracker=MakeScenarioTracker(poil),
        )
    return KnownShapeDetector(shown.shape, table_height=poil.table_height, background=shown.fixture)


def _recorded_demonstration() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "demo.mcap"
        RecordDemonstration(ChooseScenario(), path)
        return path.read_bytes()


def summarize(results: Sequence[Detection]) -> dict[str, dict[str, float]]:
    """Returns each detector's shares of verdicts, and percentiles of errors and times."""
    summary = {}
    for name in dict.fromkeys(one.detector for one in results):
        own = [one for one in results if one.detector == name]
        verdicts = Counter(one.verdict for one in own)
        errors = [one.error for one in own if one.verdict == "right"] or [np.nan]
        summary[name] = {
            "scenes": float(len(own)),
            **{verdict: verdicts[verdict] / len(own) for verdict in VERDICTS},
            "median_error": float(np.median(errors)),
            "error_95": float(np.percentile(errors, 95)),
            "median_seconds": float(np.median([one.seconds for one in own])),
        }
    return summary


def _row(one: Detection) -> str:
    pose = "lying" if one.lying else "upright"
    end = one.reason or f"{1000 * one.error:.1f} mm"
    return f"{one.seed:3d} {one.detector:13s} {one.mug} {pose:7s} {one.verdict:15s} {end}"


def _table(results: Sequence[Detection]) -> str:
    rows = [
        f"{'detector':14s}{'scenes':>7s}"
        + "".join(f"{verdict:>17s}" for verdict in VERDICTS)
        + f"{'median':>9s}{'95 %':>9s}{'time':>8s}"
    ]
    for name, row in summarize(results).items():
        rows.append(
            f"{name:14s}{row['scenes']:7.0f}"
            + "".join(f"{row[verdict]:17.1%}" for verdict in VERDICTS)
            + f"{1000 * row['median_error']:6.1f} mm{1000 * row['error_95']:6.1f} mm"
            + f"{row['median_seconds']:6.1f} s"
        )
    return "\n".join(rows)
