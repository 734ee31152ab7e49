"""What a viewer sees of a scene made by hand: live, and in a recording."""

import numpy as np
import pytest
from pydrake.geometry import Box, Cylinder, Rgba
from pydrake.math import RigidTransform

from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.diagrams.run.html_recording import CAMERA_POSITION, HtmlRecording, MakeMeshcat
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.systems.visualization.meshcat_overlay import OVERLAY_PATH
from poil_drake.systems.visualization.point_set_visualizer import (
    PointSetVisualizer,
    PointSetVisualizerConfig,
)

pytestmark = pytest.mark.browser

DURATION = 2.0  # [s]
FRAMES_PER_SECOND = 32
ROBOT_COLOR = (0.95, 0.95, 0.95)
MUG_COLOR = (0.05, 0.65, 0.75)
CONFIG = PointSetVisualizerConfig(point_radius=0.012, target_radius=0.010, tracked_radius=0.008)


def make_reference() -> PointTrajectory:
    """Six points that move by 0.3 m up and by 0.4 m along y within the duration."""
    times = np.linspace(0.0, DURATION, 33)
    corners = 0.05 * np.array(
        [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=float
    )
    motion = np.array([0.0, 0.4, 0.3]) * (times / DURATION)[:, None]
    positions = corners + np.array([0.45, -0.2, 0.15]) + motion[:, None, :]
    velocities = np.gradient(positions, times, axis=0)
    velocities[-1] = 0.0
    return PointTrajectory(times, positions, velocities)


class Scene:
    """A robot and a mug of simple shapes, and the points of a skill."""

    def __init__(self):
        self.meshcat = MakeMeshcat()
        self.reference = make_reference()
        self.meshcat.SetObject("robot", Cylinder(0.07, 0.6), Rgba(*ROBOT_COLOR))
        self.meshcat.SetTransform("robot", RigidTransform([0.0, 0.0, 0.3]))
        self.meshcat.SetObject("mug", Box(0.06, 0.06, 0.09), Rgba(*MUG_COLOR))
        self.visualizer = PointSetVisualizer(
            meshcat=self.meshcat,
            reference=self.reference,
            phase_names=["lift", "follow"],
            config=CONFIG,
        )
        self._context = self.visualizer.CreateDefaultContext()

    def publish(self, time: float) -> None:
        """Shows the scene at a time: points 20 mm behind their targets, and a growing twist."""
        target = self.reference.positions[int(time / DURATION * 32)]
        points = target - [0.0, 0.02, 0.0]
        X_WG = np.eye(4)
        X_WG[:3, 3] = target.mean(axis=0) + np.array([0.0, 0.0, 0.15])
        self._context.SetTime(time)
        for name, value in {
            "points": points.ravel(),
            "confidence": np.ones(6),
            "target_points": target.ravel(),
            "gripper_pose": X_WG.ravel(),
            "spatial_velocity": [0.3 + 0.5 * time, 0.0, 0.0, 0.0, 0.0, 0.05 + 0.1 * time],
            "phase": [0.0 if time < 1.0 else 1.0],
            "mean_error": [0.020 + 0.1 * time],
        }.items():
            self.visualizer.GetInputPort(name).FixValue(self._context, value)
        tracked = TrackedPoints(points + np.array([0.0, 0.0, 0.03]), np.ones(6), time)
        self.visualizer.GetInputPort("tracked_points").FixValue(self._context, tracked)
        self.visualizer.ForcedPublish(self._context)
        self.meshcat.SetTransform("mug", RigidTransform(target.mean(axis=0)), time)


@pytest.fixture(scope="module")
def scene():
    return Scene()


@pytest.fixture(scope="module")
def recording(scene, tmp_path_factory):
    """The scene's HTML recording."""
    path = tmp_path_factory.mktemp("recording") / "run.html"
    with HtmlRecording(scene.meshcat, path, title="By hand"):
        for frame in range(int(DURATION * FRAMES_PER_SECOND) + 1):
            scene.publish(frame / FRAMES_PER_SECOND)
    return path


@pytest.fixture
def live(page, scene):
    """The scene's live page, as of 0.5 s."""
    scene.publish(0.5)
    page.open_once(scene.meshcat.web_url())
    page.wait_for_objects(["poil/points/5"])
    return page


@pytest.fixture
def replay(page, recording):
    page.open_once(recording)
    return page


def test_the_live_page_shows_everything_in_its_colour(live):
    # Lower limits are half of the counts in a picture that looked right.
    wanted = {
        "mug": (MUG_COLOR, 700, 10_000),
        "poil/points": (CONFIG.point_color, 250, 5_000),
        "poil/target_points": (CONFIG.target_color, 190, 5_000),
        "poil/tracked_points": (CONFIG.tracked_color, 120, 5_000),
        "poil/reference": (CONFIG.reference_color, 1_500, 20_000),
        "poil/linear_velocity": (CONFIG.linear_color, 90, 3_000),
        "poil/angular_velocity": (CONFIG.angular_color, 50, 3_000),
    }
    seen = live.appearances([*wanted, "robot"])
    for path, (color, least, most) in wanted.items():
        assert least < seen[path].pixels < most, path
        assert seen[path].share_of_hue(color) > 0.5, path
    robot = seen["robot"]
    assert robot.pixels > 5_000
    assert np.ptp(robot.color) < 0.1, "white or grey"
    assert live.errors() == []


def test_a_hidden_object_has_no_appearance(live):
    live.set_visible("poil", False)
    try:
        assert live.appearance("poil/points").pixels == 0
    finally:
        live.set_visible("poil", True)


def test_a_live_page_follows(live, scene):
    before = live.appearance("poil/points").centre

    scene.publish(DURATION)
    scene.meshcat.Flush()
    live.settle()

    after = live.appearance("poil/points").centre
    assert np.linalg.norm(after - before) > 50.0


def test_a_recording_has_a_title_and_its_whole_length(replay):
    assert replay.title == "By hand"
    assert replay.duration == pytest.approx(DURATION)
    assert replay.errors() == []


def test_a_recording_moves_the_points(replay):
    replay.seek(0.0)
    start = replay.appearance("poil/points")
    replay.seek(DURATION)
    end = replay.appearance("poil/points")

    # The camera looks at the robot's front, so +y is on the right.
    across, down = end.centre - start.centre
    assert across > 100.0
    assert down < -50.0
    assert end.share_of_hue(CONFIG.point_color) > 0.5


def test_a_recording_moves_points_and_mug_together(replay):
    for seconds in (0.0, DURATION / 2, DURATION):
        replay.seek(seconds)
        seen = replay.appearances(["mug", "poil/target_points"])
        # The points surround the mug's centre; it hides those behind it.
        assert np.linalg.norm(seen["mug"].centre - seen["poil/target_points"].centre) < 30.0


def test_a_recording_changes_the_phase_shown(replay):
    shown = {}
    for seconds in (0.5, 1.5):
        replay.seek(seconds)
        names = [f"{OVERLAY_PATH}/phase/name/{index}" for index in range(2)]
        shown[seconds] = [seen.pixels for seen in replay.appearances(names).values()]

    assert shown[0.5][0] > 300
    assert shown[0.5][1] == 0
    assert shown[1.5][0] == 0
    assert shown[1.5][1] > 300


def test_a_recording_changes_the_error_shown(replay):
    def digits(seconds):
        replay.seek(seconds)
        return [
            [
                digit
                for digit in range(10)
                if replay.is_visible(f"{OVERLAY_PATH}/error/place_{place}/{digit}")
            ]
            for place in range(4)
        ]

    # 20 mm + 100 mm/s.
    assert digits(0.5) == [[], [7], [0], [0]]
    assert digits(1.5) == [[1], [7], [0], [0]]
    assert replay.appearance(f"{OVERLAY_PATH}/error").pixels > 1_000


def test_a_recording_scales_the_arrows(replay):
    replay.seek(0.0)
    short = replay.appearance("poil/linear_velocity").size
    replay.seek(DURATION - 1 / FRAMES_PER_SECOND)
    long = replay.appearance("poil/linear_velocity").size

    # The arrow points up; v grows from 0.05 m/s to 0.25 m/s.
    assert long[1] > 2.0 * short[1]


def test_the_text_moves_with_the_viewer_and_the_mug_does_not(replay):
    replay.seek(0.5)
    text = f"{OVERLAY_PATH}/phase"
    before = replay.appearances([text, "mug"])

    replay.move_viewer([0.6, 1.4, 0.5])
    after = replay.appearances([text, "mug"])
    replay.move_viewer(list(CAMERA_POSITION))

    assert np.linalg.norm(after[text].centre - before[text].centre) < 1.0
    assert np.linalg.norm(after["mug"].centre - before["mug"].centre) > 30.0


def test_the_legend_names_the_colours(replay):
    legend = replay.appearance(f"{OVERLAY_PATH}/legend")

    for color in (CONFIG.point_color, CONFIG.target_color, CONFIG.reference_color):
        assert legend.share_of_hue(color) * legend.pixels > 50
