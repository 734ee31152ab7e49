"""One file that holds the object and the fixture, which the scenario names as bodies of a model."""

from pathlib import Path

import numpy as np
import pytest
from own_models import mjcf_file, mjcf_mug, mjcf_rack, own_scenario, sdf_file, sdf_mug, sdf_shape
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from station_state import SetObjectPose

from poil_drake.diagrams.demonstration.recorder import MakeDemonstrationMotion
from poil_drake.diagrams.demonstration.scene import DemonstrationScene
from poil_drake.diagrams.run.task_success import SimulatedTruth
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station import MakeStation, RequireFreeStart
from poil_drake.errors import ScenarioError
from poil_drake.geometry.rigid_transform import make_transform


def nested_kitchen() -> str:
    """Returns a rack, which is fixed, and a mug as models nested in an SDFormat model."""
    rod = "<capsule><radius>0.0055</radius><length>0.14</length></capsule>"
    post = "<cylinder><radius>0.011</radius><length>0.28</length></cylinder>"
    shapes = sdf_shape("post", (0, 0, 0.14), post)
    shapes += f'<collision name="rod_bar"><pose>0 -0.07 0.27 1.4 0 0</pose><geometry>{rod}'
    shapes += "</geometry></collision>"
    place = "<pose>0.55 0.30 0 0 0 0</pose>"
    rack = f'<model name="stand">{place}<link name="wood">{shapes}</link></model>'
    fixed = '<joint name="f" type="fixed"><parent>world</parent><child>stand::wood</child></joint>'
    cup = sdf_mug().replace('name="cup">', 'name="body"><pose>0.47 -0.12 0 0 0 0</pose>')
    return sdf_file(f'<model name="kitchen">{rack}{fixed}{cup}</model>')


KITCHENS = {
    "welded.xml": mjcf_file(mjcf_rack(), mjcf_mug()),
    "free.xml": mjcf_file(mjcf_rack("<freejoint/>"), mjcf_mug()),
    "nested.sdf": nested_kitchen(),
}


def kitchen_scenario(folder: Path, name: str, poil: str = "") -> Scenario:
    """Returns a scenario in which one file holds mug and rack."""
    (folder / name).write_text(KITCHENS[name])
    kitchen = f"{{add_model: {{name: kitchen, file: '{folder / name}'}}}}"
    names = "object: 'kitchen::body', fixture: 'kitchen::stand'"
    poil = f"{poil or names}, demonstration_motion: {{hanging: {{rod: 'rod_.*'}}}}"
    return ChooseScenario(data=own_scenario(mug="", rack="", weld_rack="", more=kitchen, poil=poil))


@pytest.mark.parametrize("name", KITCHENS)
def test_object_and_fixture_may_be_bodies_of_one_model(name: str, tmp_path: Path) -> None:
    scenario = kitchen_scenario(tmp_path, name)

    station = MakeStation(scenario, cameras=False)
    scene = DemonstrationScene(scenario, cameras=False)
    RequireFreeStart(station)

    labels = {"table", "panda", "kitchen::body", "kitchen::stand", "kitchen::body/handle"}
    assert set(station.label_ids) == labels
    assert station.object_body().name() == "body"
    # The package's mug is demonstrated in place of the kitchen's.
    motion = MakeDemonstrationMotion(scene, scenario.poil.demonstration_motion)
    gap = scene.distance(motion.pose(motion.duration), "handle", "kitchen::stand", "rod_.*")
    assert gap == pytest.approx(0.003, abs=1e-5)
    assert scene.boxes("kitchen::body", ".*") == []


@pytest.mark.render
@pytest.mark.parametrize("own", [True, False])
def test_a_body_of_a_larger_model_is_demonstrated_under_its_name(own: bool, tmp_path: Path) -> None:
    same = f"demonstration_object: '{tmp_path}/welded.xml', " if own else ""
    names = f"{same}object: 'kitchen::body', fixture: 'kitchen::stand'"
    scene = DemonstrationScene(kitchen_scenario(tmp_path, "welded.xml", names))
    scene.put_object(make_transform(np.eye(3), [0.45, -0.1, 0.0]))

    frame = scene.capture(0.0, labels=True)

    [handle] = frame.label_ids["kitchen::body/handle"]
    assert handle in frame.label_ids["kitchen::body"]
    assert max(np.count_nonzero(image.label == handle) for image in frame.images) > 100
    assert (scene.object_name == "kitchen::body") is own


@pytest.mark.parametrize("name", KITCHENS)
def test_a_body_of_a_larger_model_hangs_on_another(name: str, tmp_path: Path) -> None:
    own = f"demonstration_object: '{tmp_path / name}', "
    names = f"{own}object: 'kitchen::body', fixture: 'kitchen::stand'"
    scenario = kitchen_scenario(tmp_path, name, names)
    motion = MakeDemonstrationMotion(
        DemonstrationScene(scenario, cameras=False), scenario.poil.demonstration_motion
    )
    station = MakeStation(scenario, cameras=False)
    simulator, truth = Simulator(station), SimulatedTruth(station)
    context, step = simulator.get_mutable_context(), scenario.poil.rates.plant

    simulator.AdvanceTo(2 * step)
    truth.observe(context)
    standing = truth.judge.touched_links
    # The motion ends 3 mm above the rod.
    X_WO = RigidTransform(motion.pose(motion.duration))
    X_WO.set_translation(X_WO.translation() - [0.0, 0.0, 0.0045])
    SetObjectPose(station, context, X_WO)
    simulator.AdvanceTo(4 * step)
    truth.observe(context)

    assert standing <= {"table::table"}
    assert truth.judge.last_touched
    assert all(touched.startswith("kitchen::stand::") for touched in truth.judge.last_touched)
    assert truth.judge.hanging_since == 4 * step


@pytest.mark.parametrize(
    ("names", "says"),
    [
        (
            "object: 'kitchen::handle', fixture: 'kitchen::stand'",
            "its base 'handle' to 'kitchen::body'",
        ),
        ("object: kitchen, fixture: 'kitchen::stand'", "have bodies in common"),
        ("object: 'kitchen::cup', fixture: 'kitchen::stand'", "'kitchen::cup', but no directive"),
    ],
)
def test_a_body_of_a_larger_model_is_named_with_its_model(
    names: str, says: str, tmp_path: Path
) -> None:
    scenario = kitchen_scenario(tmp_path, "welded.xml", f"{names}, parts: {{handle: '.*'}}")

    with pytest.raises(ScenarioError, match=says):
        MakeStation(scenario, cameras=False)
