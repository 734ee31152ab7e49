"""Safe entry: a collision-free way onto the reference from anywhere."""

import enum
from dataclasses import dataclass, field, replace

import numpy as np

from poil_drake.control.entry.entry_clearance import EntryClearanceConfig
from poil_drake.control.entry.entry_model import EntryModel
from poil_drake.control.entry.entry_rollout import EntryRolloutConfig, roll_out_entry
from poil_drake.control.entry.entry_timing import EntryTimingConfig, extended_reference
from poil_drake.control.entry.entry_transit import (
    TransitConfig,
    entry_candidates,
    searched_transit,
    straight_transit,
)
from poil_drake.control.field.bcsdm_config import BcsdmConfig
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.errors import PlanningError
from poil_drake.geometry.frozen_array import SharedOnCopy, frozen_array
from poil_drake.geometry.scene_distance import SceneDistance

_NOWHERE = np.empty((0, 4, 4))


class EntryKind(enum.Enum):
    """How the reference is entered."""

    OFF = enum.auto()
    """Safe entry is switched off: the field of the paper."""

    FIELD = enum.auto()
    """By the field itself, whose way was found to be clear."""

    STRAIGHT = enum.auto()
    """By a straight motion."""

    SEARCHED = enum.auto()
    """By a way that RRT-Connect found."""


@dataclass(frozen=True, kw_only=True)
class SafeEntryConfig:
    """How the reference is entered.

    Attributes:
        enabled: False gives the paper's field.
        progress_window: The field's on planned references, (backward, forward) [s]: a way that
            comes near itself, through a thin wall even, is not cut short. At 0.15 m/s it is 4 cm;
            between two control ticks the closest configuration moves by far less.
        on_way: An object this near to where it was to pass is on its way [m, farthest point]:
            about what 3 mm of noise of the points does to an object of 10 cm.
        tube_radius: Farther away it needs another plan, though the field may lead back [m].
        clearance: What counts as too close.
        rollout: How the field is tried out.
        transit: How a way is searched.
        timing: How fast it is followed.
    """

    enabled: bool = True
    progress_window: tuple[float, float] = (0.25, 0.25)
    on_way: float = 0.01
    tube_radius: float = 0.05
    clearance: EntryClearanceConfig = field(default_factory=EntryClearanceConfig)
    rollout: EntryRolloutConfig = field(default_factory=EntryRolloutConfig)
    transit: TransitConfig = field(default_factory=TransitConfig)
    timing: EntryTimingConfig = field(default_factory=EntryTimingConfig)


@dataclass(frozen=True, eq=False)
class EntryPlan(SharedOnCopy):
    """A reference that is safe to follow from where the object is.

    Attributes:
        reference: What is to be followed. An object of its own for each plan, so that who remembers
            a time on the reference notices when it is of another plan.
        field: By which field: the planner's, or the one that it was given if the kind is OFF.
        kind: How the demonstration is entered.
        guide: (K, 4, 4) poses X_WB that the object is going to pass until it is on the reference;
            K = 0 where the reference begins at the object, and once it is on the reference.
    """

    reference: PointTrajectory
    field: BcsdmConfig
    kind: EntryKind
    guide: np.ndarray

    def __post_init__(self) -> None:
        guide = frozen_array(self.guide, name="EntryPlan.guide", shape=("K", 4, 4))
        object.__setattr__(self, "guide", guide)


class SafeEntryPlanner:
    """Finds a way onto the reference that keeps its clearance to the scene.

    Tried in this order; the first that is free is taken:

    1. the field itself, rolled out;
    2. a straight motion to a place of the reference before its last contact, the nearest first, or
       else to the nearest of all;
    3. a way found by RRT-Connect to one of the places before the last contact.

    Attributes:
        model: Object, scene and reference.
        field: The field that is to follow the plans: the one given, with a progress window unless
            safe entry is switched off.
    """

    def __init__(
        self,
        *,
        reference: PointTrajectory,
        scene: SceneDistance,
        object_cloud: np.ndarray,
        object_points: np.ndarray,
        bcsdm: BcsdmConfig | None = None,
        config: SafeEntryConfig | None = None,
    ):
        """Measures the clearance along the reference.

        Args:
            reference: The demonstration, of the N points that are tracked.
            scene: What the object must not touch. Without the object, the hand and the arm.
            object_cloud: (Q, 3) surface of the object at one time [m, world].
            object_points: (N, 3) where the points were at that time [m, world]; NaN where not
                observed.
            bcsdm: The field.
            config: Margins and effort.

        Raises:
            TrackingError: if fewer than three of the points are finite.
        """
        self._config = config or SafeEntryConfig()
        self.model = EntryModel(
            reference=reference,
            scene=scene,
            object_cloud=object_cloud,
            object_points=object_points,
            config=self._config.clearance,
        )
        self._unguarded = self.field = bcsdm or BcsdmConfig()
        if self._config.enabled:
            self.field = replace(
                self._unguarded,
                progress_window=self._config.progress_window,
                window_escape_ratio=0.0,
            )

    def unguarded(self) -> EntryPlan:
        """Returns the demonstration as it is, to be followed from anywhere by the field given."""
        return EntryPlan(replace(self.model.reference), self._unguarded, EntryKind.OFF, _NOWHERE)

    def plan(
        self,
        points: np.ndarray,
        confidence: np.ndarray | None = None,
        *,
        seed: int = 0,
        avoid_field: bool = False,
    ) -> EntryPlan:
        """Returns a reference that leads from the points to the demonstration's end.

        Args:
            points: (N, 3) where they are [m, world]; NaN where not observed.
            confidence: (N,) weights in [0, 1]; None for all equal.
            seed: Of the search. The result depends on nothing else but the arguments.
            avoid_field: Whether to leave the first way out, because it proved to be blocked.

        Raises:
            PlanningError: if no way was found.
            TrackingError: if fewer than three points are observed.
        """
        if not self._config.enabled:
            return self.unguarded()
        model, config = self.model, self._config
        start = model.start(points, confidence)
        if not avoid_field:
            ahead = roll_out_entry(model, start, model.reference, self.field, config.rollout)
            if ahead.clear:
                reference = replace(model.reference)
                return EntryPlan(reference, self.field, EntryKind.FIELD, ahead.poses)
        places = entry_candidates(model, start, config.transit.candidates)
        kind = EntryKind.STRAIGHT
        transit = straight_transit(model, start, places)
        if transit is None:
            kind = EntryKind.SEARCHED
            transit = searched_transit(model, start, places, config.transit, seed)
        if transit is None:
            raise PlanningError(
                f"No way onto the reference was found from {np.round(start.X_WB[:3, 3], 3)}, where "
                f"the object is {1e3 * min(start.clearance, start.height):.0f} mm clear, in "
                f"{config.transit.iterations} rounds of search to each of "
                f"{config.transit.goals} places.",
                remedy="Move the object or the obstacles, lower EntryClearanceConfig.margin, or "
                "raise TransitConfig.iterations.",
            )
        reference = extended_reference(
            model.reference, transit.poses, transit.sample, config.timing
        )
        return EntryPlan(reference, self.field, kind, _NOWHERE)

    def check(
        self,
        plan: EntryPlan,
        points: np.ndarray,
        tau: float,
        confidence: np.ndarray | None = None,
    ) -> EntryPlan | None:
        """Returns the plan to go on with, None where it is not safe any more.

        Within `on_way` of the way planned, or within what noise leaves uncertain, that is the plan
        itself, its guide without what lies behind; nothing is rolled out. The way planned is where
        the reference is at tau, and what is left of the guide. Up to `tube_radius` beside it the
        field is rolled out from here: if it leads back without a collision, the plan is still
        good, with that way as its guide. Farther away it is not.

        Args:
            plan: What is followed.
            points: (N, 3) where the points are [m, world]; NaN where not observed.
            tau: The field's time of the closest configuration, on the plan's reference [s].
            confidence: (N,) weights in [0, 1]; None for all equal.

        Raises:
            TrackingError: if fewer than three points are observed.
        """
        if plan.kind is EntryKind.OFF:
            return plan
        model, config = self.model, self._config
        start = model.start(points, confidence)
        here = model.pose(plan.reference.positions_at(tau))[None]
        way = np.concatenate([here, plan.guide])
        deviations = model.displacement(start.X_WB[None], way)[0]
        (passed,) = np.nonzero(deviations <= max(config.on_way, start.slack))
        if passed.size:
            # The first of them, as a guide may come near itself.
            return _guided(plan, plan.guide[passed[0] - 1 :] if passed[0] > 0 else _NOWHERE)
        if deviations.min() > config.tube_radius:
            return None
        back = roll_out_entry(model, start, plan.reference, plan.field, config.rollout, tau=tau)
        return replace(plan, guide=back.poses) if back.clear else None


def _guided(plan: EntryPlan, guide: np.ndarray) -> EntryPlan:
    """Returns the plan with what is left of its guide; the same plan if that is all of it."""
    return plan if len(guide) == len(plan.guide) else replace(plan, guide=guide)
