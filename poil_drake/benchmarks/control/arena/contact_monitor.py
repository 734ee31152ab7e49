"""Keeps account of what an object has bumped into."""

from dataclasses import dataclass

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import GeometryId, QueryObject
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from poil_drake.errors import InvalidValueError


@dataclass(frozen=True, kw_only=True)
class CollisionThreshold:
    """From when on contact is a collision.

    Attributes:
        impulse: Of all contacts of a run together [N s]. 0.02 is a mug of 0.25 kg that is stopped
            from 8 cm/s.
        depth: Deepest penetration [m]. Where the mug's handle presses on the rod, 1 N does it.
    """

    impulse: float = 0.02
    depth: float = 0.001


class ContactMonitor(LeafSystem):
    """Adds up the contact between the driven object and the scene, step by step.

    .. pydrake_system::

        name: ContactMonitor
        input_ports:
        - contact_results
        - query_object
        - points
        output_ports:
        - impulse
        - depth

    Inputs: `contact_results` and `query_object` of plant and scene graph, and `points` (3N,)
    row-major [m, world]. Outputs are discrete state, zero at first: `impulse` (1,) the sum over
    time of the sizes of all contact forces [N s], `depth` (1,) the deepest penetration so far [m].
    Contact is left out while the points are, by their mean distance, within `tolerance` of one of
    the `intended` configurations: those in which the demonstration itself touches the scene.
    """

    def __init__(
        self,
        *,
        plant: MultibodyPlant,
        body: RigidBody,
        num_points: int,
        intended: np.ndarray | None = None,
        tolerance: float = 0.01,
    ):
        """Constructs the monitor.

        Args:
            plant: The finalized plant.
            body: A body of the object; contacts within its model instance do not count.
            num_points: N.
            intended: (K, N, 3) configurations in contact [m, world]; None for none.
            tolerance: How near to them contact is meant [m].
        """
        super().__init__()
        self._object = {
            geometry
            for index in plant.GetBodyIndices(body.model_instance())
            for geometry in plant.GetCollisionGeometriesForBody(plant.get_body(index))
        }
        self._period = plant.time_step()
        self._intended, self._tolerance = intended, tolerance
        if intended is not None and intended.shape[1:] != (num_points, 3):
            raise InvalidValueError(
                f"ContactMonitor got intended configurations of shape {intended.shape}.",
                remedy=f"Pass (K, {num_points}, 3).",
            )
        self._contacts = self.DeclareAbstractInputPort("contact_results", Value(ContactResults()))
        self._query = self.DeclareAbstractInputPort("query_object", Value(QueryObject()))
        self._points = self.DeclareVectorInputPort("points", 3 * num_points)
        for name in ("impulse", "depth"):
            self.DeclareStateOutputPort(name, self.DeclareDiscreteState([0.0]))
        self.DeclarePeriodicDiscreteUpdateEvent(self._period, 0.0, self._update)

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        contacts = self._contacts.Eval(context)
        points, surfaces = contacts.num_point_pair_contacts(), contacts.num_hydroelastic_contacts()
        if points + surfaces == 0:
            return
        found = []
        for k in range(points):
            point = contacts.point_pair_contact_info(k)
            pair = point.point_pair()
            found.append((pair.id_A, pair.id_B, point.contact_force()))
        for k in range(surfaces):
            patch = contacts.hydroelastic_contact_info(k)
            surface = patch.contact_surface()
            found.append((surface.id_M(), surface.id_N(), patch.F_Ac_W().translational()))
        found = [one for one in found if (one[0] in self._object) != (one[1] in self._object)]
        if not found or self._meant(context):
            return
        query = self._query.Eval(context)
        force = sum(float(np.linalg.norm(one[2])) for one in found)
        discrete_state.get_mutable_value(0)[0] += force * self._period
        deepest = discrete_state.get_mutable_value(1)
        deepest[0] = max(deepest[0], *(_depth(query, one[0], one[1]) for one in found))

    def _meant(self, context: Context) -> bool:
        if self._intended is None:
            return False
        points = self._points.Eval(context).reshape(-1, 3)
        distances = np.linalg.norm(self._intended - points, axis=2).mean(axis=1)
        return bool(distances.min() < self._tolerance)


def _depth(query: QueryObject, a: GeometryId, b: GeometryId) -> float:
    """Returns how deep two geometries intersect [m]; 0 where they do not."""
    return max(-query.ComputeSignedDistancePairClosestPoints(a, b).distance, 0.0)
