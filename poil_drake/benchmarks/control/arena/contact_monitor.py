"""Records the contact between an object and the scene."""

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import GeometryId, QueryObject
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

_TOLERANCE = 0.01
"""Largest mean distance of the points from an intended sample of `ContactMonitor` [m]."""


class ContactMonitor(LeafSystem):
    """Accumulates the contact between the driven object and the scene in each time step.

    .. pydrake_system::

        name: ContactMonitor
        input_ports:
        - contact_results
        - query_object
        - points
        output_ports:
        - impulse
        - depth

    Inputs: `contact_results` of the plant, `query_object` of the scene graph, and `points` (3N,)
    row-major [m, world]. Outputs are discrete state, initially zero: `impulse` (1,), the integral
    of the magnitudes of all contact forces [N s], and `depth` (1,), the deepest penetration so far
    [m]. Contact does not count while the points are within 1 cm, on average, of one of the K
    samples in `intended`.

    Args:
        plant: The finalized plant.
        body: A body of the object; contacts within its model instance do not count.
        num_points: N, number of points.
        intended: (K, N, 3) the points in the demonstration's samples with contact [m, world]; None
            if no contact is intended.
    """

    def __init__(
        self,
        *,
        plant: MultibodyPlant,
        body: RigidBody,
        num_points: int,
        intended: np.ndarray | None = None,
    ):
        super().__init__()
        self._object = {
            geometry
            for index in plant.GetBodyIndices(body.model_instance())
            for geometry in plant.GetCollisionGeometriesForBody(plant.get_body(index))
        }
        self._period = plant.time_step()
        self._intended = intended
        self._contacts = self.DeclareAbstractInputPort("contact_results", Value(ContactResults()))
        self._query = self.DeclareAbstractInputPort("query_object", Value(QueryObject()))
        self._points = self.DeclareVectorInputPort("points", 3 * num_points)
        for name in ("impulse", "depth"):
            self.DeclareStateOutputPort(name, self.DeclareDiscreteState([0.0]))
        self.DeclarePeriodicDiscreteUpdateEvent(self._period, 0.0, self._update)

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        contacts = self._contacts.Eval(context)
        forces: list[tuple[GeometryId, GeometryId, np.ndarray]] = []
        for k in range(contacts.num_point_pair_contacts()):
            point = contacts.point_pair_contact_info(k)
            pair = point.point_pair()
            forces.append((pair.id_A, pair.id_B, point.contact_force()))
        for k in range(contacts.num_hydroelastic_contacts()):
            patch = contacts.hydroelastic_contact_info(k)
            surface = patch.contact_surface()
            forces.append((surface.id_M(), surface.id_N(), patch.F_Ac_W().translational()))
        forces = [one for one in forces if (one[0] in self._object) != (one[1] in self._object)]
        if not forces or self._is_intended(context):
            return
        query = self._query.Eval(context)
        force = sum(float(np.linalg.norm(one[2])) for one in forces)
        discrete_state.get_mutable_value(0)[0] += force * self._period
        deepest = discrete_state.get_mutable_value(1)
        for a, b, _ in forces:
            distance = query.ComputeSignedDistancePairClosestPoints(a, b).distance
            deepest[0] = max(deepest[0], -distance)

    def _is_intended(self, context: Context) -> bool:
        if self._intended is None:
            return False
        points = self._points.Eval(context).reshape(-1, 3)
        distances = np.linalg.norm(self._intended - points, axis=2).mean(axis=1)
        return bool(distances.min() < _TOLERANCE)
