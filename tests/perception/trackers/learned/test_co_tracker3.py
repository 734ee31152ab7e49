import numpy as np
import pytest

from poil_drake.errors import TrackingError
from poil_drake.geometry.rigid_transform import make_transform
from poil_drake.perception.learned_models.learned_model import _warn_once
from poil_drake.perception.trackers.learned.co_tracker3 import CoTracker3
from poil_drake.perception.trackers.learned.config import CoTracker3Config


@pytest.fixture(scope="module")
def dut(installed):
    tracker = CoTracker3(CoTracker3Config(**installed("stand_in_cotracker")))
    yield tracker
    tracker.close()


@pytest.fixture(scope="module")
def started(dut, mug_scene):
    shot = mug_scene.shoot(mug_scene.start, textured=True)
    return dut.start(shot.frame, mug_scene.handle_points, shot.masks)


def test_the_tracks_of_all_views_are_lifted_and_joined(dut, started, mug_scene):
    output = started

    for k in range(1, 16):
        X_WM = make_transform(np.eye(3), np.array([0.0, 0.002 * k, 0.003 * k])) @ mug_scene.start
        frame = mug_scene.shoot(X_WM, time=k / 8, textured=True).frame
        output = dut.step(output.state, frame)

        assert not output.lost
        assert mug_scene.error(output, X_WM) < 0.005  # The stand-in drifts as optical flow does.
    assert len(output.state.recent) == 14  # With the first and the new frame, 16.


def test_a_licence_that_forbids_commercial_use_is_logged(installed, caplog):
    _warn_once.cache_clear()

    CoTracker3(CoTracker3Config(**installed("stand_in_cotracker")))

    assert "CoTracker3Config are not for commercial use: CC BY-NC 4.0" in caplog.text


def test_a_hidden_object_is_lost(dut, started, mug_scene):
    board = (((-0.2, -0.2, 0.0), (0.2, 0.2, 0.3)), mug_scene.start)
    frame = mug_scene.shoot(mug_scene.start, time=0.1, boxes=[board]).frame

    assert dut.step(started.state, frame).lost


def test_a_model_that_cannot_be_loaded_is_reported_and_its_process_ended(installed, mug_scene):
    wrong = installed("stand_in_cotracker", prefix="other.")
    dut = CoTracker3(CoTracker3Config(**wrong))
    shot = mug_scene.shoot(mug_scene.start, textured=True)

    with pytest.raises(TrackingError, match=r"CoTracker3 has failed: RuntimeError: .*other\.gain"):
        dut.start(shot.frame, mug_scene.handle_points, shot.masks)

    assert dut.pid is None
