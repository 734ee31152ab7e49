import numpy as np
import pytest
from pydrake.common.value import Value

from poil_drake.errors import InvalidValueError
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage
from poil_drake.systems.snapshot_recorder import Snapshot, SnapshotAlbum, SnapshotRecorder

CAMERA = CameraModel("left", 4, 3, np.diag([5.0, 5.0, 1.0]), np.eye(4))


def make_snapshot(time):
    return Snapshot(
        time=time,
        camera=CAMERA,
        rgb=np.zeros((3, 4, 3), np.uint8),
        points=np.zeros((2, 3)),
        target_points=np.zeros((2, 3)),
    )


def make_frame(stamp):
    image = RgbdImage(np.full((3, 4, 3), 7, np.uint8), np.ones((3, 4), np.float32), stamp)
    return MultiViewFrame((CAMERA,), (image,))


@pytest.fixture
def album():
    return SnapshotAlbum()


@pytest.fixture
def dut(album):
    return SnapshotRecorder(album=album, num_points=2, period=1 / 8, offset=1 / 256)


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


def test_snapshots_are_chosen_by_time(album):
    for time in (0.0, 1.0, 2.0, 3.0):
        album.add(make_snapshot(time))

    chosen = album.nearest_to([2.9, 0.2, 0.1])

    assert [snapshot.time for snapshot in chosen] == [0.0, 3.0]


def test_an_empty_album_has_nothing_to_choose(album):
    assert album.snapshots == ()
    assert album.nearest_to([1.0]) == ()


def test_an_album_of_one_is_refused():
    with pytest.raises(InvalidValueError, match="capacity"):
        SnapshotAlbum(capacity=1)


def test_each_frame_is_taken_once_with_the_points_of_its_time(dut, album):
    context = dut.CreateDefaultContext()
    points = np.arange(6.0)
    dut.GetInputPort("points").FixValue(context, points)
    for stamp in (0.0, 0.125):
        dut.GetInputPort("frame").FixValue(context, Value[object](make_frame(stamp)))
        dut.ForcedPublish(context)
        dut.ForcedPublish(context)

    first, second = album.snapshots
    assert (first.time, second.time) == (0.0, 0.125)
    np.testing.assert_array_equal(first.points, points.reshape(2, 3))
    assert np.all(np.isnan(first.target_points)), "not connected"
    assert first.rgb[0, 0, 0] == 7


def test_no_frame_is_no_snapshot(dut, album):
    context = dut.CreateDefaultContext()
    dut.ForcedPublish(context)
    dut.GetInputPort("frame").FixValue(context, Value[object](None))
    dut.ForcedPublish(context)

    assert album.snapshots == ()
