import gc
import os
import signal
import subprocess
import sys

import numpy as np
import pytest

from poil_drake.errors import TrackingError
from poil_drake.geometry.rigid_transform import make_transform
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.perception.trackers.process_tracker import ProcessTracker
from poil_drake.perception.trackers.protocol import TrackerOutput
from poil_drake.perception.trackers.rigid_flow.tracker import RigidFlowTracker

UP = make_transform(np.eye(3), np.array([0.0, 0.0, 0.02]))


class Counted:
    """A state that counts its instances."""

    alive = 0

    def __init__(self) -> None:
        Counted.alive += 1

    def __del__(self) -> None:
        Counted.alive -= 1


class CountingTracker:
    """Reports by its points how many states live in its process."""

    def start(self, frame, query_points, object_masks):
        return self._output(frame)

    def step(self, state, frame, motion_prior=None):
        return self._output(frame)

    def _output(self, frame):
        state = Counted()
        points = np.full((1, 3), float(Counted.alive))
        return TrackerOutput(state, TrackedPoints(points, np.ones(1), frame.stamp), lost=False)


@pytest.fixture
def dut():
    tracker = ProcessTracker(CountingTracker())
    yield tracker
    tracker.close()


@pytest.fixture
def frame(mug_scene):
    return mug_scene.shoot(mug_scene.start).frame


@pytest.fixture
def started(dut, frame):
    return dut.start(frame, np.zeros((1, 3)), ())


def test_the_result_is_that_of_the_tracker_itself(mug_scene):
    alone, beside = RigidFlowTracker(), ProcessTracker(RigidFlowTracker())
    shot = mug_scene.shoot(mug_scene.start, noisy=True)
    expected, output = (
        tracker.start(shot.frame, mug_scene.handle_points, shot.masks)
        for tracker in (alone, beside)
    )
    X_WM = mug_scene.start
    for k in range(1, 5):
        X_WM = UP @ X_WM
        frame = mug_scene.shoot(X_WM, time=k / 8, noisy=True).frame
        prior = UP if k % 2 else None
        expected = alone.step(expected.state, frame, prior)
        again = beside.step(output.state, frame, prior)
        output = beside.step(output.state, frame, prior)  # The same state may be used repeatedly.

        for result in (output, again):
            np.testing.assert_array_equal(result.points.positions, expected.points.positions)
            np.testing.assert_array_equal(result.points.confidence, expected.points.confidence)
            assert (result.points.stamp, result.lost) == (expected.points.stamp, expected.lost)
    beside.close()


def test_states_without_references_are_forgotten(dut, frame):
    output = dut.start(frame, np.zeros((1, 3)), ())
    for _ in range(6):
        output = dut.step(output.state, frame)
        gc.collect(0)

    # The new one, the one before, and one that the worker forgets with the next request.
    assert output.points.positions[0, 0] <= 3.0


def test_a_killed_worker_means_lost_and_start_starts_a_new_one(dut, frame, started):
    os.kill(dut.pid, signal.SIGKILL)

    for _ in range(2):
        with pytest.raises(TrackingError, match="process has ended"):
            dut.step(started.state, frame)
    again = dut.start(frame, np.zeros((1, 3)), ())

    with pytest.raises(TrackingError):  # A state of the worker that died.
        dut.step(started.state, frame)
    assert not dut.step(again.state, frame).lost


def test_an_interrupt_at_the_keyboard_does_not_end_the_worker(dut, frame, started):
    os.kill(dut.pid, signal.SIGINT)

    assert not dut.step(started.state, frame).lost


def test_closing_ends_the_process(dut):
    pid = dut.pid

    dut.close()

    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    assert dut.pid is None


def test_a_script_needs_no_guard_and_leaves_no_process(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "from poil_drake.perception.trackers.process_tracker import ProcessTracker\n"
        "from poil_drake.perception.trackers.rigid_flow.tracker import RigidFlowTracker\n"
        "print(ProcessTracker(RigidFlowTracker()).pid)\n"
    )

    # The script does not close it. Its output ends only when the worker has ended, too.
    run = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=True)

    assert run.stdout.strip().isdigit()
    assert run.stderr == ""
