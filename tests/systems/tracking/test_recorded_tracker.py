import numpy as np
from pydrake.systems.analysis import Simulator

from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.systems.statuses import TrackerStatus
from poil_drake.systems.tracking.recorded_tracker import RecordedTrack, RecordedTracker


def make_track(captured, released, status=TrackerStatus.TRACKING):
    track = TrackedPoints(captured + np.eye(3), np.ones(3), captured)
    return RecordedTrack(captured=captured, released=released, points=track, status=status)


def test_tracks_are_released_when_they_were():
    tracks = [make_track(0.0, 0.1875), make_track(0.125, 0.3, TrackerStatus.LOST)]
    dut = RecordedTracker(tracks=tracks, num_points=3, period=1 / 16)
    simulator = Simulator(dut)
    context = simulator.get_context()
    seen = []
    for tick in range(8):
        # After the updates of the tick.
        simulator.AdvanceTo(tick / 16 + 1 / 64)
        status = TrackerStatus(int(dut.GetOutputPort("status").Eval(context)[0]))
        stamp = dut.GetOutputPort("tracked_points").Eval(context).stamp
        seen.append((tick / 16, stamp, status.name))

    assert seen == [
        *((tick / 16, -np.inf, "WAITING") for tick in range(3)),
        (0.1875, 0.0, "TRACKING"),
        (0.25, 0.0, "TRACKING"),
        # The first tick after 0.3 s.
        (0.3125, 0.125, "LOST"),
        (0.375, 0.125, "LOST"),
        (0.4375, 0.125, "LOST"),
    ]


def test_the_times_are_those_of_the_last_release():
    dut = RecordedTracker(tracks=[make_track(0.0, 0.125)], num_points=3, period=1 / 16)
    simulator = Simulator(dut)

    before = dut.GetOutputPort("times").Eval(simulator.get_context()).copy()
    simulator.AdvanceTo(0.25)

    np.testing.assert_array_equal(before, np.full(3, -np.inf))
    after = dut.GetOutputPort("times").Eval(simulator.get_context())
    np.testing.assert_array_equal(after, [0.0, 0.125, 0.0])


def test_without_tracks_the_points_are_lost():
    dut = RecordedTracker(tracks=[], num_points=3, period=1 / 16)
    simulator = Simulator(dut)
    simulator.AdvanceTo(0.25)

    points = dut.GetOutputPort("tracked_points").Eval(simulator.get_context())

    assert points.confidence.tolist() == [0.0, 0.0, 0.0]
