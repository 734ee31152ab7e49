from pathlib import Path

import numpy as np
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

import poil_drake.models
from poil_drake.models.bag_sdf import BagParameters, handle_vertices, write_bag

SHIPPED = Path(poil_drake.models.__file__).parent / "bags" / "soft_bag" / "soft_bag.sdf"


def load(path):
    plant = MultibodyPlant(time_step=1 / 128)
    (model,) = Parser(plant).AddModels(str(path))
    plant.Finalize()
    return plant, model


def test_the_shipped_file_is_up_to_date(tmp_path):
    assert write_bag(BagParameters(), tmp_path).read_text() == SHIPPED.read_text()


def test_strap_is_an_arch_between_its_two_feet():
    bag = BagParameters(handle_width=0.1, handle_height=0.08, links=4)

    vertices = handle_vertices(bag)

    top = bag.body[2] / 2
    np.testing.assert_allclose(vertices[0], [-0.05, 0, top], atol=1e-12)
    np.testing.assert_allclose(vertices[2], [0, 0, top + 0.08], atol=1e-12)
    np.testing.assert_allclose(vertices[4], [0.05, 0, top], atol=1e-12)


def test_links_of_the_file_meet_at_the_vertices(tmp_path):
    bag = BagParameters(links=5)
    plant, _ = load(write_bag(bag, tmp_path))
    context = plant.CreateDefaultContext()
    X_BW = plant.GetBodyByName("body").EvalPoseInWorld(context).inverse()

    for k, vertex in enumerate(handle_vertices(bag)[:-1]):
        X_WH = plant.GetBodyByName(f"handle_{k}").EvalPoseInWorld(context)
        np.testing.assert_allclose(X_BW @ X_WH.translation(), vertex, atol=1e-6)


def test_the_file_has_the_parameters_mass(tmp_path):
    bag = BagParameters(mass=0.5, handle_mass=0.06)
    plant, _ = load(write_bag(bag, tmp_path))

    assert plant.CalcTotalMass(plant.CreateDefaultContext()) == pytest.approx(0.56)


def test_strap_is_closed_by_a_constraint():
    plant, model = load(SHIPPED)

    assert plant.num_constraints() == 1
    # Floating body and one bend for each link.
    assert plant.num_velocities(model) == 6 + BagParameters().links
