import numpy as np
import pytest

from poil_drake.diagrams.demonstration_scene import DemonstrationScene, demonstration_directives
from poil_drake.diagrams.load_scenario import LoadScenario, default_scenario_file
from poil_drake.errors import ScenarioError


def load(data="{}"):
    return LoadScenario(filename=default_scenario_file(), data=data)


@pytest.fixture(scope="module")
def dut():
    return DemonstrationScene(load(), cameras=False)


def at(x, y, z):
    X = np.eye(4)
    X[:3, 3] = [x, y, z]
    return X


def test_the_robot_is_left_out_and_the_object_replaced():
    models = {
        d.add_model.name: d.add_model.file
        for d in demonstration_directives(load())
        if d.add_model is not None
    }

    assert models == {
        "table": "package://poil_drake/fixtures/table.sdf",
        "rack": "package://poil_drake/fixtures/rack.sdf",
        "mug": "package://poil_drake/mugs/mug_demo/mug_demo.sdf",
    }


def test_the_scenario_keeps_its_own_object():
    scenario = load()
    files = [d.add_model.file for d in scenario.directives if d.add_model is not None]

    demonstration_directives(scenario)

    assert [d.add_model.file for d in scenario.directives if d.add_model is not None] == files
    assert scenario.directives[-1].add_model.default_free_body_pose


def test_how_deep_the_object_is_in_the_table(dut):
    assert dut.penetration(at(0.4, 0.0, 0.01)) == 0.0
    assert dut.penetration(at(0.4, 0.0, -0.004)) == pytest.approx(0.004, abs=1e-4)


def test_parts_of_the_object_do_not_count_as_obstacles(dut):
    assert dut.penetration(at(0.4, 0.0, 0.5)) == 0.0


def test_the_distance_between_links(dut):
    # The mug's bottom is 0.12 m straight above the post's top, but for the feet that it stands on.
    distance = dut.distance(at(0.55, 0.30, 0.40), "body", "rack", "stand")

    assert distance == pytest.approx(0.12, abs=3e-3)


def test_the_box_around_the_rod(dut):
    [(X_WB, half)] = dut.boxes("rack", "rod")

    # A capsule of 0.14 m and radius 5.5 mm, which leaves (0.55, 0.30, 0.26) 15 degrees upwards.
    np.testing.assert_allclose(sorted(half), [0.0055, 0.0055, 0.0755], atol=1e-6)
    u = np.array([0.0, -np.cos(np.radians(15)), np.sin(np.radians(15))])
    np.testing.assert_allclose(X_WB[:3, 3], [0.55, 0.30, 0.26] + 0.07 * u, atol=1e-5)
    assert dut.boxes("rack", "hook") == []


def test_the_fixture_must_exist():
    with pytest.raises(ScenarioError, match=r"poil\.fixture is 'hook'.*rack"):
        DemonstrationScene(load("{poil: {fixture: hook}}"), cameras=False)


def test_the_object_must_be_free():
    scenario = load()
    weld = LoadScenario(
        data="directives: [{add_weld: {parent: world, child: 'mug::body'}}]"
    ).directives
    scenario.directives.extend(weld)

    with pytest.raises(ScenarioError, match="'mug' is welded"):
        DemonstrationScene(scenario, cameras=False)
