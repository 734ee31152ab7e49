import os
import pickle
import signal
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from poil_drake.errors import MissingDependencyError, TrackingError
from poil_drake.geometry.rigid_transform import make_transform
from poil_drake.perception.images import MultiViewFrame, RgbdImage
from poil_drake.perception.trackers.learned.config import MvTrackerConfig
from poil_drake.perception.trackers.learned.model_script import make_handler
from poil_drake.perception.trackers.learned.mv_tracker import MvTracker
from poil_drake.perception.trackers.process_tracker import ProcessTracker

DIES, FREEZES, BREAKS = 255, 254, 253  # what the stand-in is told to do


@pytest.fixture(scope="module")
def config(installed):
    return MvTrackerConfig(**installed("stand_in_mvtracker", prefix="model."))


@pytest.fixture(scope="module")
def shared(config):
    tracker = MvTracker(config)
    yield tracker
    tracker.close()


@pytest.fixture
def dut(shared):
    """A tracker whose process is started only once for several tests."""
    shared._environment = shared.config  # A test may have changed its timeout.
    return shared


@pytest.fixture(scope="module")
def shoot(mug_scene):
    """Returns the frame of a mug that has risen some millimetres, and its masks."""

    @cache
    def shoot(rise=0, *, time=0.0, told=0, hidden=False):
        X_WM = make_transform(np.eye(3), np.array([0.0, 0.0, rise / 1000])) @ mug_scene.start
        shot = mug_scene.shoot(X_WM, time=time, textured=True)
        images = []
        for image in shot.frame.images:
            rgb, depth = image.rgb.copy(), image.depth.copy()
            rgb[0, 0] = rise, told, 0
            depth = np.minimum(depth, np.float32(0.3)) if hidden else depth
            images.append(RgbdImage(rgb, depth, time))
        return MultiViewFrame(shot.frame.cameras, tuple(images)), shot.masks

    return shoot


@pytest.fixture
def started(dut, shoot, mug_scene):
    return dut.start(shoot()[0], mug_scene.handle_points, shoot()[1])


def lifted(mug_scene, rise):
    return np.add(mug_scene.handle_points, [0.0, 0.0, rise / 1000])


def test_start_reports_the_query_points(started, mug_scene):
    np.testing.assert_array_equal(started.points.positions, mug_scene.handle_points)
    assert not started.lost


def test_points_are_tracked_from_the_first_step_to_beyond_a_window(dut, started, shoot, mug_scene):
    output = started

    for k in range(1, 13):
        output = dut.step(output.state, shoot(4 * k, time=k / 8)[0])

        assert not output.lost
        np.testing.assert_allclose(
            output.points.positions, lifted(mug_scene, 4 * k), atol=1e-4
        )  # float32 in the model's units
        assert output.points.stamp == k / 8
    assert output.points.confidence.min() >= 0.5
    assert len(output.state.recent) == 10  # With the first and the new frame, 12.


def test_a_state_can_be_used_again(dut, started, shoot):
    first = dut.step(started.state, shoot(5, time=0.1)[0])
    dut.step(first.state, shoot(10, time=0.2)[0])

    again = dut.step(started.state, shoot(5, time=0.1)[0])

    np.testing.assert_array_equal(again.points.positions, first.points.positions)


def test_a_hidden_object_is_lost_and_found_again_where_the_prior_puts_it(
    dut, started, shoot, mug_scene
):
    up = make_transform(np.eye(3), np.array([0.0, 0.0, 0.02]))

    hidden = dut.step(started.state, shoot(20, time=0.1, hidden=True)[0], up)
    found = dut.step(hidden.state, shoot(40, time=0.2)[0], up)

    assert hidden.lost
    np.testing.assert_array_equal(hidden.points.confidence, 0.0)
    np.testing.assert_allclose(hidden.state.predicted, up)
    assert not found.lost
    np.testing.assert_allclose(found.points.positions, lifted(mug_scene, 40), atol=1e-4)


def test_a_broken_answer_names_its_reason_and_the_process_continues(dut, started, shoot):
    with pytest.raises(TrackingError, match="MVTracker has failed: OutOfMemoryError: CUDA out"):
        dut.step(started.state, shoot(told=BREAKS)[0])

    assert not dut.step(started.state, shoot(5, time=0.1)[0]).lost


def test_a_clip_that_is_too_short_for_the_model_is_noticed(dut, started, shoot, monkeypatch):
    monkeypatch.setattr(dut, "_min_frames", 6)

    with pytest.raises(TrackingError, match="has returned no tracks"):
        dut.step(started.state, shoot(5)[0])


def test_the_model_gets_no_values_that_are_not_finite(config):
    paths = {name: getattr(config, name) for name in ("repository", "weights", "device")}
    dut = make_handler({**paths, "model": "mvtracker"})  # In this process.

    with pytest.raises(ValueError, match="not finite"):
        dut(
            {
                "clip": np.array([0]),
                "forgotten": np.array([]),
                "0/rgb": np.zeros((1, 2, 2, 3), np.uint8),
                "0/depth": np.full((1, 2, 2), np.nan),
            }
        )


def test_a_killed_process_is_replaced_at_the_next_start(dut, started, shoot, mug_scene):
    os.kill(dut.pid, signal.SIGKILL)
    with pytest.raises(TrackingError, match="has ended with status -9"):
        dut.step(started.state, shoot(5)[0])

    again = dut.start(shoot()[0], mug_scene.handle_points, shoot()[1])

    assert not dut.step(again.state, shoot(5, time=0.1)[0]).lost


@pytest.mark.parametrize(
    ("told", "reason"),
    [
        (DIES, "has ended with status 3"),
        (FREEZES, r"has not answered within 0\.5 s"),
    ],
)
def test_a_dying_or_silent_process_means_lost_until_the_next_start(
    dut, started, shoot, told, reason
):
    dut._environment = replace(dut.config, timeout=0.5)
    frame = shoot(told=told)[0]

    with pytest.raises(TrackingError, match=f"process of MVTracker {reason}"):
        dut.step(started.state, frame)

    assert dut.pid is None
    with pytest.raises(TrackingError, match="has ended"):
        dut.step(started.state, frame)


def test_it_runs_in_a_worker_process(config, shoot, mug_scene):
    dut = ProcessTracker(MvTracker(config))

    output = dut.start(shoot()[0], mug_scene.handle_points, shoot()[1])
    output = dut.step(output.state, shoot(5, time=0.1)[0])

    np.testing.assert_allclose(output.points.positions, lifted(mug_scene, 5), atol=1e-4)
    dut.close()


def test_a_copy_starts_its_own_process(dut, started):
    assert dut.pid is not None
    assert pickle.loads(pickle.dumps(dut)).pid is None


@pytest.mark.parametrize("field", ["python", "repository", "weights"])
@pytest.mark.parametrize("value", ["", "nowhere"])
def test_what_is_missing_is_named_with_the_commands_that_get_it(config, field, value):
    problem = f"{field} 'nowhere'" if value else f"no path of its {field} is set"

    with pytest.raises(MissingDependencyError, match=problem) as caught:
        MvTracker(replace(config, **{field: value}))

    assert "git clone https://github.com/ethz-vlg/mvtracker" in caught.value.remedy
