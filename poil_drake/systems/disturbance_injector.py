"""Applies pulses of force and torque to bodies of the simulated plant."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import Context, LeafSystem

from poil_drake.errors import InvalidValueError, ScenarioError


@dataclass(frozen=True, kw_only=True)
class Pulse:
    """A pulse of force and torque on a body: half a period of a sine.

    Attributes:
        body: The body that the pulse acts on, "<model instance>::<body>".
        start: When the pulse begins [s].
        duration: How long the pulse lasts [s].
        force: Peak force [N, world].
        torque: Peak torque [N m, world].
        point: Where on the body the force acts [m, body frame].
    """

    body: str
    start: float
    duration: float
    force: tuple[float, float, float] = (0.0, 0.0, 0.0)
    torque: tuple[float, float, float] = (0.0, 0.0, 0.0)
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not self.duration > 0.0:
            raise InvalidValueError(
                f"The duration of the pulse on '{self.body}' is {self.duration} s, but must be "
                "positive.",
                remedy="Set a positive duration.",
            )


def pulses_with_bodies(
    plant: MultibodyPlant, pulses: Sequence[Pulse]
) -> list[tuple[Pulse, BodyIndex]]:
    """Returns each pulse with the index of its body.

    Raises:
        ScenarioError: The plant has no body with a pulse's name.
    """
    bodies = {
        plant.get_body(BodyIndex(i)).scoped_name().get_full(): BodyIndex(i)
        for i in range(plant.num_bodies())
    }
    for pulse in pulses:
        if pulse.body not in bodies:
            raise ScenarioError(
                f"A pulse acts on '{pulse.body}', but the plant has no body of this name.",
                remedy=f"Choose one of: {', '.join(bodies)}.",
            )
    return [(pulse, bodies[pulse.body]) for pulse in pulses]


class DisturbanceInjector(LeafSystem):
    """Applies smooth pulses of force and torque to bodies.

    .. pydrake_system::

        name: DisturbanceInjector
        output_ports:
        - applied_spatial_force

    `applied_spatial_force` is a list with one `ExternallyAppliedSpatialForce` for each pulse, for
    the plant's input port of the same name. A force is zero before and after its pulse. The output
    depends on time alone.
    """

    def __init__(self, *, plant: MultibodyPlant, pulses: Sequence[Pulse]):
        """Constructs the injector.

        Args:
            plant: The finalized plant.
            pulses: The pulses.

        Raises:
            ScenarioError: if the plant has no body with a pulse's name.
        """
        super().__init__()
        self._pulses = pulses_with_bodies(plant, pulses)
        self.DeclareAbstractOutputPort(
            "applied_spatial_force",
            lambda: AbstractValue.Make([ExternallyAppliedSpatialForce()]),
            self._calc,
            {self.time_ticket()},
        )

    def _calc(self, context: Context, output: AbstractValue) -> None:
        forces = []
        for pulse, body in self._pulses:
            phase = (context.get_time() - pulse.start) / pulse.duration
            strength = float(np.sin(np.pi * phase)) if 0.0 < phase < 1.0 else 0.0
            applied = ExternallyAppliedSpatialForce()
            applied.body_index = body
            applied.p_BoBq_B = np.array(pulse.point)
            applied.F_Bq_W = SpatialForce(
                tau=strength * np.array(pulse.torque), f=strength * np.array(pulse.force)
            )
            forces.append(applied)
        output.set_value(forces)
