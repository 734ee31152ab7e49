from dataclasses import dataclass

import numpy as np
import pytest

from poil_drake.errors import TrackingError
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.perception.trackers.protocol import TrackerOutput
from poil_drake.transfer.demonstration_tracks import track_demonstration

QUERY = np.arange(12.0).reshape(4, 3)
X = np.array([1.0, 0.0, 0.0])
MASKS = (np.ones((2, 2), dtype=bool),)


def frames(count: int) -> list[MultiViewFrame]:
    camera = CameraModel("camera", 2, 2, np.eye(3), np.eye(4))
    image = np.zeros((2, 2, 3)), np.ones((2, 2))
    return [MultiViewFrame((camera,), (RgbdImage(*image, 5.0 + 0.5 * k),)) for k in range(count)]


@dataclass(frozen=True)
class ShiftingTracker:
    """Moves the points by 1 along x per frame; loses or misses points in some frames."""

    lost: tuple[int, ...] = ()
    missing: tuple[int, ...] = ()

    def start(self, frame, query_points, object_masks) -> TrackerOutput:
        assert object_masks is MASKS
        return TrackerOutput(0, TrackedPoints(query_points, np.ones(4), frame.stamp), False)

    def step(self, state, frame, motion_prior=None) -> TrackerOutput:
        k = state + 1
        if k in self.lost:
            return TrackerOutput(k, TrackedPoints.lost(4, frame.stamp), True)
        positions, confidence = QUERY + k * X, np.full(4, 0.8)
        if k in self.missing:
            positions[0], confidence[0] = np.nan, 0.0
        return TrackerOutput(k, TrackedPoints(positions, confidence, frame.stamp), False)


def test_tracks_start_at_time_zero_and_cover_every_frame() -> None:
    tracks = track_demonstration(frames(4), QUERY, MASKS, tracker=ShiftingTracker(missing=(2,)))

    np.testing.assert_allclose(tracks.times, [0.0, 0.5, 1.0, 1.5])
    np.testing.assert_allclose(tracks.positions[3], QUERY + 3.0 * X)
    assert np.isnan(tracks.positions[2, 0]).all()
    np.testing.assert_allclose(tracks.confidence[2], [0.0, 0.8, 0.8, 0.8])


def test_a_short_gap_is_tolerated() -> None:
    tracks = track_demonstration(
        frames(6), QUERY, MASKS, tracker=ShiftingTracker(lost=(2, 3)), max_gap=1.1
    )

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
        track_demonstration(frames(6), QUERY, MASKS, tracker=ShiftingTracker(lost), max_gap=1.1)
