from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context
from station_state import GetObjectPose

from poil_drake.diagrams.scenario.load import ChooseScenario, LoadScenario
from poil_drake.diagrams.station.cameras.incremental_renderer import IncrementalRenderer
from poil_drake.diagrams.station.station import CaptureFrame, MakeStation, Station
from poil_drake.errors import ScenarioError, StationError
from poil_drake.models.mug_family import NAMED_MUGS
from poil_drake.models.mug_shape import handle_center_line
from poil_drake.perception.images import CameraModel

pytestmark = pytest.mark.render

TEST_FILE = Path(__file__).parents[1] / "scenarios.yaml"


@pytest.fixture(scope="module")
def station() -> Station:
    scenario = ChooseScenario(data="{poil: {depth_noise: {enabled: false}}}")
    return MakeStation(scenario, ignore_output_delay=True)


@pytest.fixture(scope="module")
def context(station: Station) -> Context:
    return station.CreateDefaultContext()


def project(camera: CameraModel, p_W: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    p_C = (p_W - camera.X_WC[:3, 3]) @ camera.X_WC[:3, :3]
    pixels = p_C @ camera.K.T
    return np.round(pixels[:, :2] / pixels[:, 2:]).astype(int), p_C[:, 2]


def test_the_handle_is_drawn_where_the_geometry_says(station: Station, context: Context) -> None:
    frame = CaptureFrame(station, context, labels=True)
    mug = next(m for m in NAMED_MUGS if m.name == "mug_a")
    X_WO = GetObjectPose(station, context).GetAsMatrix4()
    line = handle_center_line(mug, 30)[4:-4] @ X_WO[:3, :3].T + X_WO[:3, 3]

    seen = 0
    for camera, image in zip(frame.cameras, frame.images, strict=True):
        (u, v), z = (a.T for a in project(camera, line))
        labels = image.label[v, u]
        handle = np.isin(labels, frame.label_ids["mug/handle"])
        # Pixels that do not show the handle show the mug's body in front of it.
        assert np.all(np.isin(labels, frame.label_ids["mug"]))
        # The surface is nearer than the tube's centre line by about its radius, or by more where a
        # nearer stretch of the handle hides it.
        depth = image.depth[v, u][handle]
        assert np.all(depth < z[handle])
        assert np.mean(depth > z[handle] - 2 * mug.handle_radius) > 0.7
        seen += handle.sum()
    assert seen > len(line)


def test_both_cameras_see_the_mug_its_handle_and_the_rod(
    station: Station, context: Context
) -> None:
    frame = CaptureFrame(station, context, labels=True)

    for image in frame.images:
        count = {k: np.isin(image.label, ids).sum() for k, ids in frame.label_ids.items()}
        assert count["mug"] > 2000
        assert count["mug/handle"] > 150
        assert count["rack"] > 2000
        assert count["panda"] > 1000


def test_the_images_are_well_exposed(station: Station, context: Context) -> None:
    for image in CaptureFrame(station, context, labels=True).images:
        brightness = image.rgb[image.label == station.label_ids["table"][0]].mean()
        mug = image.rgb[np.isin(image.label, station.label_ids["mug"])]
        assert 80 < brightness < 200
        assert np.mean(mug.max(axis=1) >= 255) < 0.05
        # The mug is striped.
        assert mug.std(axis=0).max() > 30


def test_the_table_is_where_the_depth_says(station: Station, context: Context) -> None:
    frame = CaptureFrame(station, context, labels=True)

    for camera, image in zip(frame.cameras, frame.images, strict=True):
        v, u = np.nonzero(image.label == station.label_ids["table"][0])
        rays = np.stack([u, v, np.ones_like(u)]) * image.depth[v, u]
        points = camera.X_WC[:3, :3] @ np.linalg.solve(camera.K, rays)
        height = points[2] + camera.X_WC[2, 3]
        # Half a pixel at a slant of 45 degrees is under a millimetre and a half here.
        assert np.quantile(np.abs(height), 0.99) < 1.5e-3


@pytest.mark.parametrize(
    "depth_pose",
    [
        "{translation: [0.015, 0, 0]}",
        "{translation: [-0.03, 0.01, 0], rotation: !Rpy {deg: [0, 1, 2]}}",
    ],
)
def test_depth_beside_colour_is_registered_to_it(
    station: Station, context: Context, depth_pose: str
) -> None:
    data = (
        f"{{poil: {{depth_noise: {{enabled: false}}}}, cameras: {{left: {{X_BD: {depth_pose}}}}}}}"
    )
    offset = MakeStation(ChooseScenario(data=data), ignore_output_delay=True)
    offset_context = offset.CreateDefaultContext()

    got = CaptureFrame(offset, offset_context).images[0].depth
    rendered = IncrementalRenderer(offset, offset.scene_graph(), ["left"]).capture(offset_context)

    wanted = CaptureFrame(station, context).images[0].depth
    both = (got > 0.0) & (wanted > 0.0)
    assert np.mean(both[wanted > 0.0]) > 0.9
    # One pixel is 3 mm of depth on the table's far end; silhouettes are off by a pixel.
    assert np.quantile(np.abs(got - wanted)[both], 0.95) < 3e-3
    np.testing.assert_array_equal(rendered[0].depth, got)


def test_labels_are_rendered_only_on_request(station: Station, context: Context) -> None:
    frame = CaptureFrame(station, context)

    assert all(image.label is None for image in frame.images)
    assert dict(frame.label_ids) == {}
    assert frame.stamp == 0.0


def test_one_of_everything_with_a_cup_in_mjcf() -> None:
    scenario = LoadScenario(filename=TEST_FILE, scenario_name="OneOfEverything")
    station = MakeStation(scenario)
    context = station.CreateDefaultContext()

    frame = CaptureFrame(station, context, labels=True)

    assert set(frame.label_ids) == {"table", "rack", "panda", "cup", "cup/grip"}
    (image,), (camera,) = frame.images, frame.cameras
    assert image.rgb.shape == (120, 160, 3)
    # The grip's outer bar, turned by 90 degrees from +x to +y, as the camera sees it.
    X_WO = GetObjectPose(station, context)
    assert X_WO.IsNearlyEqualTo(RigidTransform(X_WO.rotation(), [0.45, -0.10, 0.0]), 1e-9)
    (u, v), _ = (a.T for a in project(camera, np.array([[0.45, -0.03, 0.045]])))
    assert image.label[v[0], u[0]] in frame.label_ids["cup/grip"]
    (u, v), _ = (a.T for a in project(camera, np.array([[0.48, -0.10, 0.085]])))
    assert image.label[v[0], u[0]] in frame.label_ids["cup"]
    assert image.label[v[0], u[0]] not in frame.label_ids["cup/grip"]


SILENT = "rgb: false, depth: false, label: false"
ON_A_NETWORK = 'lcm_buses: {default: {lcm_url: "memq://"}}'


def test_delayed_images_are_not_published() -> None:
    with pytest.raises(ScenarioError, match=r"left has an output_delay, .* lcm_buses.default") as e:
        ChooseScenario(data=f"{{{ON_A_NETWORK}}}")

    assert "rgb, depth and label to false" in e.value.remedy


@pytest.mark.parametrize("ignore_output_delay", [False, True])
def test_cameras_that_publish_nothing_still_render(ignore_output_delay: bool) -> None:
    silent = f"cameras: {{left: {{{SILENT}}}, right: {{{SILENT}}}}}"
    scenario = ChooseScenario(data=f"{{{ON_A_NETWORK}, {silent}}}")
    station = MakeStation(scenario, ignore_output_delay=ignore_output_delay)

    frame = CaptureFrame(station, station.CreateDefaultContext(), labels=True)
    station.Close()

    for image in frame.images:
        assert image.rgb.std() > 10.0
        assert np.isin(image.label, frame.label_ids["mug"]).sum() > 2000


@pytest.mark.parametrize("callback", ["parser_preload_callback", "parser_prefinalize_callback"])
def test_parser_callbacks_are_not_supported_with_delayed_cameras(callback: str) -> None:
    scenario = ChooseScenario()
    added = {callback: lambda parser: None}

    with pytest.raises(StationError, match="not supported with delayed cameras") as info:
        MakeStation(scenario, **added)

    assert "ignore_output_delay=True" in info.value.remedy
    prompt = MakeStation(scenario, ignore_output_delay=True, **added)
    assert prompt.camera_names == ("left", "right")
