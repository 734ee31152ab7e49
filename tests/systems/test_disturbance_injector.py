import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from poil_drake.errors import InvalidValueError, ScenarioError
from poil_drake.systems.disturbance_injector import DisturbanceInjector, Pulse, half_sine

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


def test_half_sine_peaks_in_the_middle_and_is_zero_outside() -> None:
    times = [0.9, 1.0, 1.1, 1.2, 1.3, 1.4, 1.5]

    strengths = [half_sine(time, start=1.0, duration=0.4) for time in times]

    np.testing.assert_allclose(strengths, [0, 0, np.sqrt(0.5), 1, np.sqrt(0.5), 0, 0], atol=1e-12)


def test_forces_at_the_peak_and_outside(plant: MultibodyPlant) -> None:
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
    port = dut.GetOutputPort("applied_spatial_force")

    (before,) = port.Eval(context)
    context.SetTime(1.2)
    (peak,) = port.Eval(context)

    body = plant.GetBodyByName("body", plant.GetModelInstanceByName("mug"))
    assert peak.body_index == body.index()
    np.testing.assert_array_equal(peak.p_BoBq_B, [0.01, 0.0, 0.05])
    np.testing.assert_allclose(peak.F_Bq_W.translational(), [3.0, 0.0, -1.0])
    np.testing.assert_allclose(peak.F_Bq_W.rotational(), [0.0, 0.2, 0.0])
    np.testing.assert_array_equal(before.F_Bq_W.get_coeffs(), np.zeros(6))


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
