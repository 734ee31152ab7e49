"""Ground-truth judgement of a simulated run: does the object hang on its fixture?"""

import math
from dataclasses import dataclass

from pydrake.geometry import SceneGraphInspector
from pydrake.multibody.plant import ContactResults, MultibodyPlant


def TouchedBodies(
    plant: MultibodyPlant,
    inspector: SceneGraphInspector,
    contact_results: ContactResults,
    instance_name: str,
) -> frozenset[str]:
    """Returns the scoped names ("rack::rod") of the bodies that touch a model instance.

    Args:
        plant: The simulated plant.
        inspector: Its scene graph's inspector.
        contact_results: The value of the plant's `contact_results` port.
        instance_name: The instance whose contacts are asked for. Contacts within it are left out.
    """
    pairs = []
    for i in range(contact_results.num_point_pair_contacts()):
        point = contact_results.point_pair_contact_info(i)
        pairs.append((plant.get_body(point.bodyA_index()), plant.get_body(point.bodyB_index())))
    for i in range(contact_results.num_hydroelastic_contacts()):
        surface = contact_results.hydroelastic_contact_info(i).contact_surface()
        frames = [inspector.GetFrameId(surface.id_M()), inspector.GetFrameId(surface.id_N())]
        pairs.append((plant.GetBodyFromFrameId(frames[0]), plant.GetBodyFromFrameId(frames[1])))
    touched: set[str] = set()
    for pair in pairs:
        owners = [plant.GetModelInstanceName(body.model_instance()) for body in pair]
        for body, other in ((0, 1), (1, 0)):
            if owners[other] == instance_name != owners[body]:
                touched.add(f"{owners[body]}::{pair[body].name()}")
    return frozenset(touched)


@dataclass
class HangingJudge:
    """Watches contacts until the object has hung for long enough.

    The object hangs while it touches the fixture's holder, and nothing but the fixture: it may
    lean against the fixture's other bodies, but standing on one of them is no hanging. What counts
    is the time for which it has done so without a break, up to now.

    Attributes:
        holder: Scoped name of the body that holds a hanging object, e.g. "rack::rod".
        longest_flight: For how long an object may touch nothing, e.g. while it swings [s].
        hanging_since: Since when the object hangs [s]; None while it does not.
        holder_touched_at: When it last touched the holder [s].
        last_touched: What the object touched last.
    """

    holder: str
    longest_flight: float = 0.1
    hanging_since: float | None = None
    holder_touched_at: float = -math.inf
    last_touched: frozenset[str] = frozenset()

    def observe(self, time: float, touched: frozenset[str]) -> None:
        """Takes in which bodies the object touches at a time [s]."""
        self.last_touched = touched
        if self.holder in touched:
            self.holder_touched_at = time
        fixture = self.holder.split("::")[0] + "::"
        foreign = any(not body.startswith(fixture) for body in touched)
        if foreign or time - self.holder_touched_at > self.longest_flight:
            self.hanging_since = None
        elif self.hanging_since is None:
            self.hanging_since = time

    def hanging_time(self, time: float) -> float:
        """Returns for how long [s] the object has hung."""
        return 0.0 if self.hanging_since is None else time - self.hanging_since
