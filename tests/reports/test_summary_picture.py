import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.colors import to_rgb

from poil_drake.perception.images import CameraModel
from poil_drake.reports.run_summary import PhaseSpan
from poil_drake.reports.summary_panels import COLORS, SummaryData, spread_out
from poil_drake.reports.summary_picture import common_view, make_summary_picture
from poil_drake.systems.logging.snapshot_recorder import Snapshot

# A camera at the origin that looks along +z, with its principal point at pixel (80, 60).
CAMERA = CameraModel(
    "left", 160, 120, np.array([[100, 0, 80], [0, 100, 60], [0, 0, 1.0]]), np.eye(4)
)


def make_snapshot(points, time=0.0):
    points = np.asarray(points, dtype=float)
    return Snapshot(
        time=time,
        camera=CAMERA,
        rgb=np.full((120, 160, 3), 90, np.uint8),
        points=points,
        target_points=points + 0.01,
    )


def make_data(**changes):
    times = np.arange(0.0, 4.0, 1 / 32)
    errors = 0.03 * np.exp(-times)[:, None] * np.array([0.8, 1.0, 1.2])
    errors[times < 1.0] = np.nan
    values = {
        "title": "Hang a mug",
        "success": True,
        "reason": "the mug hung for 2.0 s",
        "times": times,
        "point_errors": errors,
        "potential": 0.5 * np.sum(errors**2, axis=1),
        "tau": np.clip(times - 1.0, 0.0, 2.0),
        "reference_duration": 2.0,
        "joint_velocities": np.sin(times)[:, None] * np.linspace(0.1, 1.0, 7),
        "velocity_limits": np.full(7, 2.0),
        "phases": [
            PhaseSpan(name="approach", start=0.0, end=1.0),
            PhaseSpan(name="follow", start=1.0, end=4.0),
        ],
    }
    return SummaryData(**(values | changes))


def draw(path, data):
    make_summary_picture(path, data)
    return cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB)


def count(picture, color):
    """Counts the pixels of exactly a colour."""
    wanted = np.round(np.array(to_rgb(color)) * 255.0)
    return np.count_nonzero(np.all(np.abs(picture - wanted) <= 1.0, axis=2))


def test_the_verdict_has_its_colour(tmp_path):
    success = draw(tmp_path / "a.png", make_data())
    failure = draw(tmp_path / "b.png", make_data(success=False))

    assert count(success, COLORS["success"]) > 1_000 > count(success, COLORS["failure"])
    assert count(failure, COLORS["failure"]) > 1_000 > count(failure, COLORS["success"])


def test_snapshots_show_the_points(tmp_path):
    without = draw(
        tmp_path / "a.png", make_data(snapshots=[make_snapshot(np.full((3, 3), np.nan))])
    )
    points = np.column_stack([np.linspace(-0.2, 0.2, 9), np.zeros(9), np.ones(9)])
    with_points = draw(tmp_path / "b.png", make_data(snapshots=[make_snapshot(points)]))

    assert count(with_points, COLORS["points"]) > count(without, COLORS["points"]) + 100
    assert count(with_points, COLORS["target"]) > count(without, COLORS["target"]) + 100


def test_the_tracking_error_has_a_panel_if_the_truth_is_known(tmp_path):
    known = {"tracking_times": np.array([1.0, 2.0]), "tracking_errors": np.full((2, 3), 0.002)}

    without = draw(tmp_path / "a.png", make_data())
    with_truth = draw(tmp_path / "b.png", make_data(**known))

    assert with_truth.shape[0] > without.shape[0]
    assert with_truth.shape[1] == without.shape[1] == 1800


def test_signals_without_finite_values_are_drawn_empty(tmp_path):
    signals = ("point_errors", "potential", "tau", "joint_velocities", "reference_duration")
    unknown = {name: np.nan * getattr(make_data(), name) for name in signals}

    assert draw(tmp_path / "a.png", make_data(**unknown)).size


@pytest.mark.parametrize(
    ("points", "view"),
    [
        # The pixels (80, 60) and (100, 60), with 19.2 px on either side, in the proportions 4:3.
        ([[0.0, 0.0, 1.0], [0.2, 0.0, 1.0]], [60.3, 118.7, 37.6, 81.4]),
        # 38.4 px high around the pixel (1, 1), moved into the picture.
        ([[-0.79, -0.59, 1.0]], [-0.5, 50.7, -0.5, 37.9]),
        # The whole picture, because the point is behind the camera.
        ([[0.0, 0.0, -1.0]], [-0.5, 159.5, -0.5, 119.5]),
    ],
)
def test_the_view_surrounds_the_points(points, view):
    np.testing.assert_allclose(common_view([make_snapshot(points)]), view)


@given(st.lists(st.floats(0.0, 10.0), max_size=10).map(sorted))
def test_names_are_moved_apart_and_stay_in_order(places):
    dut = spread_out(np.array(places), gap=0.5, upper=10.0)

    assert np.all(np.diff(dut) >= 0.5 - 1e-9)
    assert np.all(dut <= 10.0 + 1e-9)


def test_names_far_enough_apart_stay():
    np.testing.assert_array_equal(
        spread_out(np.array([0.0, 1.0, 2.0]), gap=0.5, upper=2.0), [0, 1, 2]
    )
