"""Ground-truth judgement of a simulated run: does the object hang on its fixture?"""

import math
from dataclasses import dataclass

from pydrake.geometry import SceneGraphInspector
from pydrake.multibody.plant import ContactResults, MultibodyPlant

from poil_drake.diagrams.scenario.collision_parts import CollisionGeometries, ScopedGeometryName


def TouchedGeometries(
    plant: MultibodyPlant,
    inspector: SceneGraphInspector,
    contact_results: ContactResults,
    model: str,
) -> frozenset[str]:
    """Returns the scoped names ("rack::rod::bar") of the geometries that touch a model.

    Args:
        plant: The simulated plant.
        inspector: Its scene graph's inspector.
        contact_results: The value of the plant's `contact_results` port.
        model: The instance whose contacts are asked for. Contacts within it are left out.
    """
    pairs = []
    for i in range(contact_results.num_point_pair_contacts()):
        point = contact_results.point_pair_contact_info(i).point_pair()
        pairs.append((point.id_A, point.id_B))
    for i in range(contact_results.num_hydroelastic_contacts()):
        surface = contact_results.hydroelastic_contact_info(i).contact_surface()
        pairs.append((surface.id_M(), surface.id_N()))
    touched = set()
    for pair in pairs:
        a, b = (ScopedGeometryName(plant, inspector, geometry_id) for geometry_id in pair)
        for name, other in ((a, b), (b, a)):
            if other.startswith(f"{model}::") and not name.startswith(f"{model}::"):
                touched.add(name)
    return frozenset(touched)


def HolderGeometries(
    plant: MultibodyPlant, inspector: SceneGraphInspector, fixture: str, part: str
) -> frozenset[str]:
    """Returns the scoped names of a fixture's geometries on which an object hangs.

    Args:
        plant: The plant.
        inspector: Its scene graph's inspector.
        fixture: The fixture's model instance.
        part: Its link, or a pattern on the names of geometries.
    """
    return frozenset(
        ScopedGeometryName(plant, inspector, geometry_id)
        for geometry_id in CollisionGeometries(plant, inspector, fixture, part)
    )


@dataclass
class HangingJudge:
    """Watches contacts until the object has hung for long enough.

    The object hangs while it touches the fixture's holder, and nothing but the fixture: it may
    lean against the rest of the fixture, but standing on that is no hanging. What counts is the
    time for which it has done so without a break, up to now.

    Attributes:
        fixture: The fixture's model instance, e.g. "rack".
        holder: Scoped names of the geometries that hold a hanging object, e.g. "rack::rod::bar".
        longest_flight: For how long an object may touch nothing, e.g. while it swings [s].
        hanging_since: Since when the object hangs [s]; None while it does not.
        holder_touched_at: When it last touched the holder [s].
        last_touched: What the object touched last.
    """

    fixture: str
    holder: frozenset[str]
    longest_flight: float = 0.1
    hanging_since: float | None = None
    holder_touched_at: float = -math.inf
    last_touched: frozenset[str] = frozenset()

    def observe(self, time: float, touched: frozenset[str]) -> None:
        """Takes in which geometries, by their scoped names, the object touches at a time [s]."""
        self.last_touched = touched
        if self.holder & touched:
            self.holder_touched_at = time
        foreign = any(not name.startswith(f"{self.fixture}::") for name in touched)
        if foreign or time - self.holder_touched_at > self.longest_flight:
            self.hanging_since = None
        elif self.hanging_since is None:
            self.hanging_since = time

    @property
    def touched_links(self) -> frozenset[str]:
        """Scoped names of the links that the object touched last, e.g. "rack::rod"."""
        return frozenset(name.rpartition("::")[0] for name in self.last_touched)

    def hanging_time(self, time: float) -> float:
        """Returns for how long [s] the object has hung."""
        return 0.0 if self.hanging_since is None else time - self.hanging_since
