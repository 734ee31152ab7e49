"""The tracking benchmark on a few small frames."""

import json
from pathlib import Path

import numpy as np
import pytest

from poil_drake.benchmarks.tracking import trial
from poil_drake.benchmarks.tracking.carried_motion import with_slip
from poil_drake.benchmarks.tracking.cases import CASES
from poil_drake.benchmarks.tracking.sequence import HANG, MakeSequence, TrackingSequence, slip_time
from poil_drake.benchmarks.tracking.tracking import run_tracking_benchmark
from poil_drake.diagrams.scenario.poil_config import PoilConfig
from poil_drake.errors import InvalidValueError, MissingDependencyError, TrackingError
from poil_drake.geometry.rigid_transform import inverse
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.perception.trackers.protocol import TrackerOutput

SMALL = "{cameras: {left: {width: 320, height: 240}, right: {width: 320, height: 240}}}"


class Follower:
    """A tracker that trusts its motion prior."""

    def __init__(self, config: object = None):
        pass

    def start(
        self, frame: MultiViewFrame, query_points: np.ndarray, object_masks: tuple[np.ndarray, ...]
    ) -> TrackerOutput:
        points = TrackedPoints(query_points, np.ones(len(query_points)), frame.stamp)
        return TrackerOutput((points, 0), points, False)

    def step(
        self,
        state: tuple[TrackedPoints, int],
        frame: MultiViewFrame,
        motion_prior: np.ndarray | None = None,
    ) -> TrackerOutput:
        points, count = state
        X = np.eye(4) if motion_prior is None else motion_prior
        moved = points.positions @ X[:3, :3].T + X[:3, 3]
        new = TrackedPoints(moved, points.confidence, frame.stamp)
        return TrackerOutput((new, count + 1), new, False)


@pytest.fixture(scope="module")
def sequence() -> TrackingSequence:
    return MakeSequence(HANG, 1, max_frames=12, data=SMALL)


def test_the_object_follows_the_hand_that_holds_it(sequence: TrackingSequence) -> None:
    motion = sequence.motion

    X_GO = inverse(motion.hand_poses) @ motion.object_poses

    np.testing.assert_allclose(X_GO[motion.held] - X_GO[-1], 0.0, atol=1e-9)
    rests = motion.object_poses[~motion.held]
    assert len(rests) > 1
    np.testing.assert_allclose(rests - rests[0], 0.0, atol=1e-12)


def test_a_slip_is_3_cm_and_20_deg(sequence: TrackingSequence) -> None:
    before = sequence.motion
    after = with_slip(before, slip_time(before), np.random.default_rng(3))
    late = after.times >= slip_time(after)

    slip = inverse(before.object_poses) @ after.object_poses

    assert np.linalg.norm(slip[late][:, :3, 3], axis=1) == pytest.approx(0.03)
    cosines = (np.trace(slip[late][:, :3, :3], axis1=1, axis2=2) - 1.0) / 2.0
    assert np.degrees(np.arccos(cosines)) == pytest.approx(20.0)
    np.testing.assert_allclose(slip[~late] - np.eye(4), 0.0, atol=1e-9)


def test_the_points_lie_on_the_object_in_the_first_frame(sequence: TrackingSequence) -> None:
    dut = sequence
    camera, image = dut.frames[0].cameras[0], dut.frames[0].images[0]

    points = dut.query_points(dut.frames[0])
    p = (points - camera.X_WC[:3, 3]) @ camera.X_WC[:3, :3] @ camera.K.T
    u, v = np.rint(p[:, :2] / p[:, 2:]).astype(int).T

    # Points on the far side are a handle's thickness behind what this view shows.
    near = np.abs(image.depth[v, u] - p[:, 2]) < 0.02
    assert near.mean() > 0.5
    np.testing.assert_allclose(dut.moved(points, 0), points, atol=1e-12)


def test_a_tracker_that_trusts_its_prior_is_right_while_the_grasp_is_rigid(
    sequence: TrackingSequence,
) -> None:
    track, tiles = trial.follow(Follower(), sequence, CASES["none"], prior=True, seed=0)
    blind, _ = trial.follow(Follower(), sequence, CASES["none"], prior=False, seed=0)

    assert np.nanmax(track.errors) < 1e-9
    assert np.nanmax(blind.errors) > 0.1
    assert len(tiles) == 8


def test_an_occluded_object_is_hidden(sequence: TrackingSequence) -> None:
    track, _ = trial.follow(Follower(), sequence, CASES["occluded"], prior=True, seed=0)

    start, end = track.disturbance or (np.nan, np.nan)
    covered = (track.times >= start) & (track.times < end)
    assert covered.any()
    assert (track.visible[covered] == 0.0).all()
    assert (track.visible[~covered] > 0.1).all()


def test_frames_that_do_not_arrive_are_not_tracked(sequence: TrackingSequence) -> None:
    whole, _ = trial.follow(Follower(), sequence, CASES["none"], prior=True, seed=0)
    dut, _ = trial.follow(Follower(), sequence, CASES["dropped"], prior=True, seed=0)

    start, end = dut.disturbance or (np.nan, np.nan)
    arrived = whole.times[(whole.times < start) | (whole.times >= end)]
    assert dut.times.tolist() == arrived.tolist()


def test_an_error_of_the_tracker_counts_as_lost(
    sequence: TrackingSequence, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> TrackerOutput:
        raise TrackingError("Too dark.", remedy="Light.")

    monkeypatch.setattr(Follower, "step", fail)
    track, _ = trial.follow(Follower(), sequence, CASES["none"], prior=True, seed=0)

    assert track.lost.tolist() == [False] + [True] * (len(track.lost) - 1)


def test_the_results_are_written_and_missing_weights_are_a_row(
    sequence: TrackingSequence, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    from poil_drake.benchmarks.tracking import tracking

    def make(poil: PoilConfig) -> Follower:
        if poil.tracker == "rigid_flow":
            raise MissingDependencyError("The weights are missing.", remedy="Get them.")
        return Follower()

    def here(function: object, arguments: list, shared: tuple, **_: object) -> object:
        return ((k, trial.run_trial(*shared, *one)) for k, one in enumerate(arguments))

    monkeypatch.setattr(trial, "MakeScenarioTracker", make)
    monkeypatch.setattr(trial, "MakeSequence", lambda kind, seed, **_: sequence)
    monkeypatch.setattr(tracking, "run_trials", here)
    monkeypatch.setitem(tracking.TRACKERS, "follower", (Follower, object))
    table = run_tracking_benchmark(
        trackers=["rigid_flow", "follower"],
        cases=["none", "occluded"],
        trials=1,
        priors=[True],
        json_path=tmp_path / "b.json",
    )

    assert table["rigid_flow", True, "none"]["problem"] == (
        "weights not present (The weights are missing.)"
    )
    assert float(table["follower", True, "none"]["error_p95"]) < 1e-9
    written = json.loads((tmp_path / "b.json").read_text())
    assert [row["tracker"] for row in written["summary"]] == ["rigid_flow", "follower"] * 2
    assert (tmp_path / "tracking.png").exists()
    assert (tmp_path / "tracking_occluded.png").exists()


@pytest.mark.parametrize(("trackers", "cases"), [(["eyes"], ["none"]), (["rigid_flow"], ["fog"])])
def test_an_unknown_name_is_refused(trackers: list[str], cases: list[str], tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match=r"'(eyes|fog)'"):
        run_tracking_benchmark(
            trackers=trackers, cases=cases, trials=1, json_path=tmp_path / "b.json"
        )
