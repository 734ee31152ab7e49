import numpy as np
import pytest

from poil_drake.errors import InvalidValueError, TrackingError
from poil_drake.geometry.rigid_transform import inverse, make_transform, rotation_exp
from poil_drake.perception.trackers.lucas_kanade import LucasKanadeConfig, LucasKanadeTracker


@pytest.fixture
def dut():
    return LucasKanadeTracker()


@pytest.fixture
def started(dut, mug_scene):
    shot = mug_scene.shoot(mug_scene.start, textured=True)
    return dut.start(shot.frame, mug_scene.handle_points, shot.masks)


def turned(mug_scene, degrees, rise):
    """The mug's pose after a turn about its own axis and a rise [m]."""
    turn = rotation_exp(np.radians([0.0, 0.0, degrees]))
    return mug_scene.start @ make_transform(turn, np.array([0.0, 0.0, rise]))


def test_start_reports_the_query_points(started, mug_scene):
    np.testing.assert_array_equal(started.points.positions, mug_scene.handle_points)
    np.testing.assert_array_equal(started.points.confidence, 1.0)


def test_a_textured_mug_is_followed(dut, started, mug_scene):
    output = started

    for k in range(1, 9):
        X_WM = turned(mug_scene, 3 * k, 0.005 * k)
        output = dut.step(output.state, mug_scene.shoot(X_WM, time=k / 8, textured=True).frame)

        assert not output.lost
        assert mug_scene.error(output, X_WM) < 0.004  # It drifts.


def test_points_move_rigidly_even_if_no_view_shows_them(dut, started, mug_scene):
    # A finger in front of the handle; most of the cup stays visible.
    finger = (((0.035, -0.03, 0.0), (0.09, 0.03, 0.09)), mug_scene.start)
    frame = mug_scene.shoot(mug_scene.start, time=0.1, textured=True, boxes=[finger]).frame

    output = dut.step(started.state, frame)

    assert not output.lost
    assert mug_scene.error(output, mug_scene.start) < 0.004  # Patches beside the finger see it.
    assert 0.0 < output.points.confidence.max() <= 0.5


def test_a_far_step_needs_the_motion_prior(dut, started, mug_scene):
    X_WM = turned(mug_scene, 12.0, 0.1)
    frame = mug_scene.shoot(X_WM, time=0.1, textured=True).frame

    blind = dut.step(started.state, frame)
    guided = dut.step(started.state, frame, X_WM @ inverse(mug_scene.start))

    assert blind.lost or mug_scene.error(blind, X_WM) > 0.02
    assert mug_scene.error(guided, X_WM) < 0.002


def test_a_hidden_mug_is_lost_and_found_again(dut, started, mug_scene):
    board = (((-0.2, -0.2, 0.0), (0.2, 0.2, 0.3)), mug_scene.start)
    X_WM = turned(mug_scene, 3.0, 0.004)

    hidden = dut.step(
        started.state, mug_scene.shoot(mug_scene.start, time=0.1, boxes=[board]).frame
    )
    found = dut.step(hidden.state, mug_scene.shoot(X_WM, time=0.2, textured=True).frame)

    assert hidden.lost
    np.testing.assert_array_equal(hidden.points.confidence, 0.0)
    assert mug_scene.error(found, X_WM) < 0.002


def test_masks_that_show_too_little_are_refused(dut, mug_scene):
    shot = mug_scene.shoot(mug_scene.start)
    none = tuple(np.zeros_like(mask) for mask in shot.masks)

    with pytest.raises(TrackingError, match="No masked pixel has usable depth"):
        dut.start(shot.frame, mug_scene.handle_points, none)
    with pytest.raises(InvalidValueError, match="object_masks have shapes"):
        dut.start(shot.frame, mug_scene.handle_points, shot.masks[:1])


@pytest.mark.parametrize("wrong", [{"window": 2}, {"levels": 11}, {"max_return_error": 0.0}])
def test_parameters_out_of_range_are_refused(wrong):
    (name,) = wrong
    with pytest.raises(InvalidValueError, match=f"LucasKanadeConfig.{name} is"):
        LucasKanadeConfig(**wrong)
