from dataclasses import dataclass

import numpy as np
import pytest

from poil_drake.errors import TrackingError
from poil_drake.geometry.rigid_transform import rotation_exp
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.perception.trackers.protocol import TrackerOutput
from poil_drake.recording.demonstration.demonstration import Demonstration
from poil_drake.transfer.demonstration_tracks import DemonstrationTracks, track_demonstration

QUERY = np.arange(12.0).reshape(4, 3)
X = np.array([1.0, 0.0, 0.0])
MASKS = (np.ones((2, 2), dtype=bool),)


def frames(count: int, *, period: float = 0.5) -> Demonstration:
    camera = CameraModel("camera", 2, 2, np.eye(3), np.eye(4))
    image = np.zeros((2, 2, 3)), np.ones((2, 2))
    images = [RgbdImage(*image, 5.0 + period * k) for k in range(count)]
    return Demonstration([MultiViewFrame((camera,), (image,)) for image in images])


@dataclass(frozen=True)
class GivenTracks:
    """Returns given positions (T, N, 3), NaN where not observed; loses them in some frames."""

    positions: np.ndarray
    lost: tuple[int, ...] = ()

    def start(self, frame, query_points, object_masks) -> TrackerOutput:
        assert object_masks is MASKS
        return self.step(-1, frame)

    def step(self, state, frame, motion_prior=None) -> TrackerOutput:
        k, positions = state + 1, self.positions[state + 1]
        if k in self.lost:
            return TrackerOutput(k, TrackedPoints.lost(len(positions), frame.stamp), True)
        confidence = np.where(np.isfinite(positions).all(axis=1), 0.8, 0.0)
        return TrackerOutput(k, TrackedPoints(positions, confidence, frame.stamp), False)


def shifted(count: int) -> np.ndarray:
    """Positions (count, 4, 3) of points that move by 1 along x per frame."""
    return QUERY + np.arange(count)[:, None, None] * X


def test_tracks_start_at_time_zero_and_cover_every_frame() -> None:
    positions = shifted(4)
    positions[2, 0] = np.nan

    tracks = track_demonstration(frames(4), QUERY, MASKS, tracker=GivenTracks(positions))

    np.testing.assert_allclose(tracks.times, [0.0, 0.5, 1.0, 1.5])
    np.testing.assert_allclose(tracks.positions[3], QUERY + 3.0 * X)
    assert np.isnan(tracks.positions[2, 0]).all()
    np.testing.assert_allclose(tracks.confidence[2], [0.0, 0.8, 0.8, 0.8])


def test_a_short_gap_is_tolerated() -> None:
    tracker = GivenTracks(shifted(6), lost=(2, 3))

    tracks = track_demonstration(frames(6), QUERY, MASKS, tracker=tracker)

    assert np.isnan(tracks.positions[2:4]).all()
    np.testing.assert_allclose(tracks.positions[4], QUERY + 4.0 * X)


@pytest.mark.parametrize(
    ("lost", "says"),
    [
        pytest.param((2, 3, 4), r"0\.50 s into the .* lasts 2\.50 s", id="too long"),
        pytest.param((5,), r"2\.00 s into", id="in the last frame"),
    ],
)
def test_a_loss_raises_with_its_time(lost: tuple[int, ...], says: str) -> None:
    with pytest.raises(TrackingError, match=says):
        track_demonstration(frames(6), QUERY, MASKS, tracker=GivenTracks(shifted(6), lost))


BODY = 0.03 * np.random.default_rng(0).normal(size=(8, 3))


def turning_body(count: int) -> np.ndarray:
    """Positions (count, 8, 3) of a body that moves along x and turns by 10 degrees per frame."""
    turns = rotation_exp(np.radians(10.0) * np.arange(count)[:, None] * X)
    return BODY @ turns.swapaxes(1, 2) + 0.1 * np.arange(count)[:, None, None] * X


def test_points_that_change_places_are_left_out_from_then_on() -> None:
    positions = turning_body(10)
    positions[6:, [2, 5]] = positions[6:, [5, 2]]

    tracks = track_demonstration(frames(10), BODY, MASKS, tracker=GivenTracks(positions))

    expected = np.full((10, 8), 0.8)
    expected[6:, [2, 5]] = 0.0
    np.testing.assert_array_equal(tracks.confidence, expected)
    assert np.isnan(tracks.positions[6:, [2, 5]]).all()


def test_a_point_that_drifts_is_left_out_beyond_a_centimetre() -> None:
    positions = turning_body(10)
    # Up to 3 cm; the best motion of all points shares an eighth of it.
    positions[:, 3] += np.linspace(0.0, 0.03, 10)[:, None] * np.array([0.0, 0.6, 0.8])

    tracks = track_demonstration(frames(10), BODY, MASKS, tracker=GivenTracks(positions))

    kept = tracks.confidence[:, 3] > 0.0
    assert kept[:3].all()
    assert not kept[5:].any()
    assert (np.delete(tracks.confidence, 3, axis=1) == 0.8).all()


def test_a_body_that_falls_apart_is_lost() -> None:
    positions = turning_body(6)
    positions[3:] += 0.05 * np.random.default_rng(1).normal(size=(3, 8, 3))

    with pytest.raises(TrackingError, match=r"lost the object 1\.00 s into"):
        track_demonstration(frames(6), BODY, MASKS, tracker=GivenTracks(positions))


class Follower:
    """Follows points on a path (T, N, 3) with given stamps (T,).

    It is sure of itself (1.0) if frames are at most `certain` apart [s], and unsure (0.5) or, to
    `lose`, lost if they are farther apart.
    """

    def __init__(self, stamps, path, *, certain: float = np.inf, lose: bool = False):
        self._stamps, self._path, self._certain, self._lose = stamps, path, certain, lose

    def start(self, frame, query_points, object_masks) -> TrackerOutput:
        return self.step(frame.stamp, frame)

    def step(self, state, frame, motion_prior=None) -> TrackerOutput:
        points = self._path[np.searchsorted(self._stamps, frame.stamp)]
        sure = frame.stamp - state <= self._certain
        if self._lose and not sure:
            lost = TrackedPoints.lost(len(points), frame.stamp)
            return TrackerOutput(frame.stamp, lost, True)
        confidence = np.full(len(points), 1.0 if sure else 0.5)
        tracked = TrackedPoints(points, confidence, frame.stamp)
        return TrackerOutput(frame.stamp, tracked, False)


def test_slow_motion_is_tracked_less_often() -> None:
    recorded = frames(33, period=1 / 32)
    # The body moves at 0.08 m/s for half a second, then at 0.64 m/s.
    times = recorded.stamps - 5.0
    way = np.where(times < 0.5, 0.08 * times, 0.04 + 0.64 * (times - 0.5))
    path = BODY + way[:, None, None] * X

    tracks = track_demonstration(recorded, BODY, MASKS, tracker=Follower(recorded.stamps, path))

    gaps = np.diff(tracks.times)
    assert gaps[0] == 1 / 32  # The speed is unknown.
    assert gaps.max() == 0.25
    assert (gaps[tracks.times[:-1] > 0.75] <= 1 / 16).all()
    assert tracks.times[-1] == 1.0


@pytest.mark.parametrize("lose", [False, True], ids=["unsure", "lost"])
def test_no_frame_is_skipped_where_that_misleads_the_tracker(lose: bool) -> None:
    recorded = frames(33, period=1 / 32)
    path = np.repeat(BODY[None], 33, axis=0)
    tracker = Follower(recorded.stamps, path, certain=1 / 16, lose=lose)

    tracks = track_demonstration(recorded, BODY, MASKS, tracker=tracker)

    assert len(tracks.times) == 33
    np.testing.assert_array_equal(tracks.confidence, 1.0)


def test_other_points_of_the_object_are_carried_along() -> None:
    positions = turning_body(4)
    confidence = np.full((4, 8), 0.8)
    confidence[1, :6] = 0.0  # Too few points for a motion.
    confidence[2, :3] = 0.2
    tracks = DemonstrationTracks(np.arange(4.0), positions, confidence)
    other = np.array([[0.0, 0.0, 0.0], [0.0, 0.1, 0.0]])

    dut = tracks.carried(other)

    # The body turns about x by 30 degrees and shifts along x by 0.3 until the last frame.
    turned = [0.3, 0.1 * np.cos(np.radians(30.0)), 0.1 * np.sin(np.radians(30.0))]
    np.testing.assert_allclose(dut.positions[3], [[0.3, 0.0, 0.0], turned], atol=1e-9)
    assert np.isnan(dut.positions[1]).all()
    np.testing.assert_array_equal(dut.confidence[:, 0], [0.8, 0.0, 0.8, 0.8])
    np.testing.assert_array_equal(dut.confidence[:, 1], dut.confidence[:, 0])
