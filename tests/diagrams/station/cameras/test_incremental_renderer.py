"""Images of which only what has moved is rendered."""

from collections.abc import Iterable

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context
from station_state import SetObjectPose

from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.diagrams.station.cameras.incremental_renderer import IncrementalRenderer
from poil_drake.diagrams.station.simulated_station import SimulatedStation
from poil_drake.diagrams.station.station import MakeStation
from poil_drake.perception.images import RgbdImage

pytestmark = pytest.mark.render


def make(shadows: bool) -> tuple[SimulatedStation, Context, IncrementalRenderer]:
    scenario = ChooseScenario(data="{poil: {depth_noise: {enabled: false}}}")
    for camera in scenario.cameras.values():
        camera.renderer_class.cast_shadows = shadows
    station = MakeStation(scenario, ignore_output_delay=True)
    dut = IncrementalRenderer(station, station.scene_graph(), station.camera_names)
    return station, station.CreateDefaultContext(), dut


@pytest.fixture(scope="module")
def without_shadows() -> tuple[SimulatedStation, Context, IncrementalRenderer]:
    return make(shadows=False)


def differing(images: Iterable[RgbdImage], expected: Iterable[RgbdImage]) -> tuple[float, float]:
    """Returns the largest shares of colour and depth pixels in which images differ."""
    pairs = list(zip(images, expected, strict=True))
    return (
        max(float((a.rgb != b.rgb).any(axis=2).mean()) for a, b in pairs),
        max(float((np.abs(a.depth - b.depth) > 1e-4).mean()) for a, b in pairs),
    )


def test_a_moving_scene_looks_as_if_everything_were_rendered(without_shadows: tuple) -> None:
    station, context, dut = without_shadows
    plant = station.plant()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    rng = np.random.default_rng(0)
    start = plant.GetPositions(plant_context)

    shares = []
    for k in range(12):
        q = start.copy()
        q[:7] += 0.05 * k * rng.standard_normal(7)
        plant.SetPositions(plant_context, q)
        pose = RigidTransform([0.4 + 0.02 * k, -0.1 + 0.03 * k, 0.1])
        SetObjectPose(station, context, pose)
        shares.append(differing(dut.capture(context).values(), station.TakeImages(context)))

    assert shares[0] == (0.0, 0.0)
    # A geometry that is left behind, or not erased, covers several hundred pixels: 1e-3.
    assert (np.max(shares, axis=0) <= [5e-4, 2e-5]).all()


def test_what_rests_is_not_rendered_again(
    without_shadows: tuple, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, context, dut = without_shadows
    before = dut.capture(context)
    monkeypatch.setattr("pydrake.geometry.QueryObject.RenderColorImage", None)
    monkeypatch.setattr("pydrake.geometry.QueryObject.RenderDepthImage", None)

    context.SetTime(context.get_time() + 0.125)
    after = dut.capture(context)

    assert differing(after.values(), before.values()) == (0.0, 0.0)
    assert [image.stamp for image in after.values()] == [before["left"].stamp + 0.125] * 2


def test_with_shadows_everything_is_rendered() -> None:
    station, context, dut = make(shadows=True)

    for y in (-0.1, 0.0):
        SetObjectPose(station, context, RigidTransform([0.5, y, 0.2]))

        assert differing(dut.capture(context).values(), station.TakeImages(context)) == (0.0, 0.0)
