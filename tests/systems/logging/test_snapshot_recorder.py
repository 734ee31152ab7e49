import numpy as np
import pytest
from small_frames import camera, make_frame
from system_bench import SystemBench

from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.systems.absent import ABSENT
from poil_drake.systems.logging.snapshot_recorder import Snapshot, SnapshotAlbum, SnapshotRecorder

CAMERA = camera("left")
PERIOD, OFFSET = 1 / 8, 1 / 256
START = np.array([[0.5, 0.0, 0.1], [0.6, 0.0, 0.1], [0.5, 0.1, 0.2], [0.6, 0.1, 0.1]])
N = len(START)
NO_TRACK = TrackedPoints.lost(N, -np.inf)
# The points rise by 0.2 m in 2 s.
RISE = np.linspace(0.0, 0.2, 3)[:, None, None] * np.array([0.0, 0.0, 1.0])
SPEED = np.array([0.1, 0.1, 0.0])[:, None, None] * np.array([0.0, 0.0, 1.0])
REFERENCE = PointTrajectory(
    np.array([0.0, 1.0, 2.0]), START + RISE, np.broadcast_to(SPEED, (3, N, 3))
)


def make_snapshot(time):
    return Snapshot(
        time=time,
        camera=CAMERA,
        rgb=np.zeros((3, 4, 3), np.uint8),
        points=np.zeros((2, 3)),
        target_points=np.zeros((2, 3)),
    )


def lifted(height, *, aside=0.0):
    """Returns the start, shifted up by `height` and sideways by `aside` [m]."""
    return START + np.array([aside, 0.0, height])


def seen(stamp, height=0.05):
    """Returns a track of the start, shifted up by `height` [m] and sideways by 10 mm."""
    return TrackedPoints(lifted(height, aside=0.01), np.ones(N), stamp)


@pytest.fixture
def album():
    return SnapshotAlbum()


@pytest.fixture
def bench(album):
    """The recorder in a simulator."""
    dut = SnapshotRecorder(
        album=album, camera=CAMERA, reference=REFERENCE, period=PERIOD, offset=OFFSET
    )
    return SystemBench(dut, frame=ABSENT, tracked_points=NO_TRACK)


@pytest.mark.parametrize("count", [1, 7, 8, 9, 31, 1000])
def test_an_album_stays_small_and_keeps_first_and_last(count):
    dut = SnapshotAlbum(capacity=8)

    for time in range(count):
        dut.add(make_snapshot(float(time)))

    times = [snapshot.time for snapshot in dut.snapshots]
    assert len(times) <= 9
    assert len(times) >= min(count, 4)
    assert times[0] == 0.0
    assert times[-1] == count - 1
    steps = np.diff(times[:-1])
    assert len(set(steps)) <= 1, "evenly spaced but for the last"


@pytest.mark.parametrize(("kept", "chosen"), [([0.0, 1.0, 2.0, 3.0], [0.0, 3.0]), ([], [])])
def test_snapshots_are_chosen_by_time(album, kept, chosen):
    for time in kept:
        album.add(make_snapshot(time))

    assert [snapshot.time for snapshot in album.nearest_to([2.9, 0.2, 0.1])] == chosen


@pytest.mark.parametrize("late", [0, 1, 2, 5])
def test_each_frame_is_taken_once_with_its_own_track(bench, album, late):
    for tick in range(8):
        track = NO_TRACK
        if tick >= late:
            track = seen((tick - late) * PERIOD, height=0.01 * (tick - late))
        bench.fix(frame=make_frame(tick), tracked_points=track)
        bench.advance(PERIOD)
    for _ in range(3):  # Nothing new arrives.
        bench.advance(PERIOD)

    assert [snapshot.time for snapshot in album.snapshots] == [k / 8 for k in range(8 - late)]
    for tick, snapshot in enumerate(album.snapshots):
        height = 0.01 * tick
        np.testing.assert_allclose(snapshot.points, lifted(height, aside=0.01))
        # The reference's closest configuration is straight above the start, at that height.
        np.testing.assert_allclose(snapshot.target_points, lifted(height), atol=1e-12)
        np.testing.assert_array_equal(snapshot.rgb, make_frame(tick).images[0].rgb)


@pytest.mark.parametrize(
    ("lost", "target"), [([0, 1, 2, 3], np.full((N, 3), np.nan)), ([0], lifted(0.05))]
)
def test_lost_points_are_nan_and_have_a_target_if_others_are_seen(bench, album, lost, target):
    positions, confidence = lifted(0.05, aside=0.01), np.ones(N)
    positions[lost], confidence[lost] = np.nan, 0.0

    bench.fix(frame=make_frame(0), tracked_points=TrackedPoints(positions, confidence, 0.0))
    bench.advance(PERIOD)

    (snapshot,) = album.snapshots
    np.testing.assert_array_equal(np.isnan(snapshot.points), np.isnan(positions))
    np.testing.assert_allclose(snapshot.target_points, target, atol=1e-12)


def test_no_frame_is_no_snapshot(bench, album):
    bench.advance(PERIOD)
    bench.fix(frame=ABSENT, tracked_points=seen(0.0))
    bench.advance(PERIOD)

    assert album.snapshots == ()


def test_the_stored_images_are_in_the_context(bench, album):
    bench.fix(frame=make_frame(0), tracked_points=NO_TRACK)
    bench.advance(PERIOD)
    other = bench.dut.CreateDefaultContext()
    other.SetTimeStateAndParametersFrom(bench.context)
    bench.dut.GetInputPort("frame").FixValue(other, make_frame(1))
    bench.dut.GetInputPort("tracked_points").FixValue(other, seen(0.0))

    bench.dut.ForcedPublish(other)

    assert [snapshot.time for snapshot in album.snapshots] == [0.0]


def test_images_are_dropped_once_they_are_tracked(bench):
    for tick in range(6):
        bench.fix(frame=make_frame(tick), tracked_points=seen((tick - 1) * PERIOD))
        bench.advance(PERIOD)

    images = bench.context.get_abstract_state(0).get_value()
    assert [image.stamp for image in images] == [5 * PERIOD]
