"""Ground truth of a simulated run: the object's pose, and whether it hangs on its fixture."""

import math
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import SceneGraphInspector
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.systems.framework import Context

from poil_drake.diagrams.scenario.model_parts import CollisionGeometries
from poil_drake.diagrams.scenario.penetrations import WORLD, ScopedNames
from poil_drake.diagrams.station.station import SimulatedStation

_LONGEST_FLIGHT = 0.1
"""How long a hanging object may lose contact with the holder, e.g. while it swings [s]."""


def TouchedGeometries(
    plant: MultibodyPlant,
    inspector: SceneGraphInspector,
    contact_results: ContactResults,
    model: str,
    *,
    fixture: str = "",
) -> frozenset[str]:
    """Returns the scoped names ("rack::rod::bar") of the geometries that touch a model.

    Args:
        plant: The simulated plant.
        inspector: The inspector of the plant's scene graph.
        contact_results: The value of the plant's `contact_results` port.
        model: The model, see `ModelBodies`. Contacts within the model are ignored.
        fixture: A model whose name is the scope of its geometries, even if it is part of another.
    """
    names = ScopedNames(plant, inspector, (model, fixture))
    pairs = []
    for i in range(contact_results.num_point_pair_contacts()):
        point = contact_results.point_pair_contact_info(i).point_pair()
        pairs.append((point.id_A, point.id_B))
    for i in range(contact_results.num_hydroelastic_contacts()):
        surface = contact_results.hydroelastic_contact_info(i).contact_surface()
        pairs.append((surface.id_M(), surface.id_N()))
    touched = set()
    for pair in pairs:
        a, b = (names.get(geometry_id, WORLD) for geometry_id in pair)
        for name, other in ((a, b), (b, a)):
            if other.startswith(f"{model}::") and not name.startswith(f"{model}::"):
                touched.add(name)
    return frozenset(touched)


@dataclass
class HangingJudge:
    """Observes contacts, and measures how long the object has hung.

    The object hangs while it touches the fixture's holder, e.g. a rod. It may also touch other
    parts of the fixture, but nothing else. It may lose contact with the holder for 0.1 s. The
    hanging time counts from when the object last began to hang.

    Attributes:
        fixture: The fixture's name, e.g. "rack".
        holder: Scoped names of the geometries on which the object hangs, e.g. "rack::rod::bar".
        hanging_since: When the object began to hang [s]; None while it does not hang.
        holder_touched_at: When the object last touched the holder [s].
        last_touched: The geometries that the object touched at the last observation.
    """

    fixture: str
    holder: frozenset[str]
    hanging_since: float | None = None
    holder_touched_at: float = -math.inf
    last_touched: frozenset[str] = frozenset()

    def observe(self, time: float, touched: frozenset[str]) -> None:
        """Records the scoped names of the geometries that the object touches at a time [s]."""
        self.last_touched = touched
        if self.holder & touched:
            self.holder_touched_at = time
        foreign = any(not name.startswith(f"{self.fixture}::") for name in touched)
        if foreign or time - self.holder_touched_at > _LONGEST_FLIGHT:
            self.hanging_since = None
        elif self.hanging_since is None:
            self.hanging_since = time

    @property
    def touched_links(self) -> frozenset[str]:
        """Scoped names of the links touched at the last observation, e.g. "rack::rod"."""
        return frozenset(name.rpartition("::")[0] for name in self.last_touched)

    def hanging_time(self, time: float) -> float:
        """Returns how long the object has hung without interruption [s] at `time` [s]."""
        return 0.0 if self.hanging_since is None else time - self.hanging_since


class SimulatedTruth:
    """The true state of the object in a simulated station. Nothing in a loop may depend on it.

    Attributes:
        judge: Measures how long the object has hung.
    """

    def __init__(self, station: SimulatedStation):
        """Stores the station. The judge has observed nothing yet."""
        poil, plant = station.scenario.poil, station.plant()
        inspector = station.scene_graph().model_inspector()
        rod = poil.demonstration_motion.hanging.rod
        holder = frozenset(
            f"{poil.fixture}::{geometry.link}::{geometry.name}"
            for geometry in CollisionGeometries(plant, inspector, poil.fixture, rod)
        )
        self._station = station
        self.judge = HangingJudge(fixture=poil.fixture, holder=holder)

    def object_pose(self, root: Context) -> np.ndarray:
        """Returns X_WO, the (4, 4) pose of the object's base body, from the root context."""
        context = self._station.plant().GetMyContextFromRoot(root)
        return self._station.object_body().EvalPoseInWorld(context).GetAsMatrix4()

    def plant_state(self, root: Context) -> np.ndarray:
        """Returns the positions and velocities of the simulated plant."""
        plant = self._station.plant()
        return plant.GetPositionsAndVelocities(plant.GetMyContextFromRoot(root))

    def observe(self, root: Context) -> None:
        """Reports to the judge what the object touches now."""
        context = self._station.GetMyContextFromRoot(root)
        touched = TouchedGeometries(
            self._station.plant(),
            self._station.GetOutputPort("query_object").Eval(context).inspector(),
            self._station.GetOutputPort("contact_results").Eval(context),
            self._station.scenario.poil.object,
            fixture=self._station.scenario.poil.fixture,
        )
        self.judge.observe(root.get_time(), touched)
