import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from poil_drake.errors import InvalidValueError, ScenarioError
from poil_drake.systems.disturbance_injector import DisturbanceInjector, Pulse

MASS = 2.0


@pytest.fixture
def plant() -> MultibodyPlant:
    """Two free bodies without gravity, each in its own model instance."""
    plant = MultibodyPlant(time_step=1 / 512)
    for name in ("mug", "rack"):
        plant.AddRigidBody(
            "body",
            plant.AddModelInstance(name),
            SpatialInertia.SolidSphereWithMass(mass=MASS, radius=0.1),
        )
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    plant.Finalize()
    return plant


@pytest.mark.parametrize(
    ("time", "strength"),
    [(0.9, 0), (1.0, 0), (1.1, np.sqrt(0.5)), (1.2, 1), (1.3, np.sqrt(0.5)), (1.4, 0), (1.5, 0)],
)
def test_forces_peak_in_the_middle_and_are_zero_outside(
    plant: MultibodyPlant, time: float, strength: float
) -> None:
    pulse = Pulse(
        body="mug::body",
        start=1.0,
        duration=0.4,
        force=(3.0, 0.0, -1.0),
        torque=(0.0, 0.2, 0.0),
        point=(0.01, 0.0, 0.05),
    )
    dut = DisturbanceInjector(plant=plant, pulses=[pulse])
    context = dut.CreateDefaultContext()
    context.SetTime(time)

    (applied,) = dut.GetOutputPort("applied_spatial_force").Eval(context)

    body = plant.GetBodyByName("body", plant.GetModelInstanceByName("mug"))
    assert applied.body_index == body.index()
    np.testing.assert_array_equal(applied.p_BoBq_B, [0.01, 0.0, 0.05])
    expected = strength * np.array([0.0, 0.2, 0.0, 3.0, 0.0, -1.0])
    np.testing.assert_allclose(applied.F_Bq_W.get_coeffs(), expected, atol=1e-12)


def test_a_pushed_body_gains_the_pulses_momentum(plant: MultibodyPlant) -> None:
    builder = DiagramBuilder()
    builder.AddSystem(plant)
    pulse = Pulse(body="mug::body", start=0.25, duration=0.5, force=(4.0, 0.0, 0.0))
    dut = builder.AddSystem(DisturbanceInjector(plant=plant, pulses=[pulse]))
    builder.Connect(
        dut.GetOutputPort("applied_spatial_force"), plant.get_applied_spatial_force_input_port()
    )
    simulator = Simulator(builder.Build())

    simulator.AdvanceTo(1.0)

    context = plant.GetMyContextFromRoot(simulator.get_context())
    velocities = {
        name: plant.EvalBodySpatialVelocityInWorld(
            context, plant.GetBodyByName("body", plant.GetModelInstanceByName(name))
        ).translational()
        for name in ("mug", "rack")
    }
    # The integral of a half sine is 2 / pi of its height times its duration; the plant samples it
    # at 256 points, which is exact to 1e-4.
    np.testing.assert_allclose(velocities["mug"], [2 / np.pi * 4.0 * 0.5 / MASS, 0, 0], rtol=1e-4)
    np.testing.assert_array_equal(velocities["rack"], np.zeros(3))


def test_an_unknown_body_is_refused_with_the_choices(plant: MultibodyPlant) -> None:
    pulse = Pulse(body="cup::body", start=0.0, duration=1.0)

    with pytest.raises(ScenarioError, match="mug::body, rack::body"):
        DisturbanceInjector(plant=plant, pulses=[pulse])


def test_a_pulse_without_duration_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="duration"):
        Pulse(body="mug::body", start=0.0, duration=0.0)
