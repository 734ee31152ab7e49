"""Safe entry: a collision-free path onto the reference from anywhere."""

import enum
from dataclasses import dataclass, field, replace

import numpy as np

from poil_drake.control.entry.entry_clearance import EntryClearanceConfig
from poil_drake.control.entry.entry_model import EntryModel
from poil_drake.control.entry.entry_paths import (
    TransitConfig,
    entry_candidates,
    roll_out_entry,
    searched_transit,
    straight_transit,
)
from poil_drake.control.entry.entry_timing import extended_reference
from poil_drake.control.field.point_set_bcsdm import BcsdmConfig
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.errors import PlanningError
from poil_drake.geometry.frozen_array import freeze_fields
from poil_drake.geometry.scene_cloud import SceneCloud

_NO_GUIDE = np.empty((0, 4, 4))

_PROGRESS_WINDOW = (0.25, 0.25)
"""The field's progress window (backward, forward) on planned references [s]. It prevents shortcuts
where a path comes near itself, even through a thin wall. At 0.15 m/s it is 4 cm long on each side;
between two control ticks the closest configuration moves much less."""


class EntryKind(enum.Enum):
    """How the reference is entered."""

    OFF = enum.auto()
    """Safe entry is switched off: the paper's field alone."""

    FIELD = enum.auto()
    """By the field itself, whose path is clear."""

    STRAIGHT = enum.auto()
    """By a straight motion."""

    SEARCHED = enum.auto()
    """By a path that RRT-Connect found."""


@dataclass(frozen=True, kw_only=True)
class SafeEntryConfig:
    """How the reference is entered.

    Attributes:
        enabled: Whether to plan the entry. If False, the paper's field is used alone.
        on_way: An object within this distance of the planned path counts as on the path [m,
            farthest point]. Noise of 3 mm in the points moves the far side of an object of 10 cm by
            about this distance.
        tube_radius: Within this distance of the path, the field may lead the object back to it.
            Farther away the object needs another plan [m, farthest point].
        clearance: The required clearance.
        transit: Effort of the search for a path.
    """

    enabled: bool = True
    on_way: float = 0.01
    tube_radius: float = 0.05
    clearance: EntryClearanceConfig = field(default_factory=EntryClearanceConfig)
    transit: TransitConfig = field(default_factory=TransitConfig)


@dataclass(frozen=True, eq=False)
class EntryPlan:
    """A reference that is safe to follow from the object's present pose.

    Attributes:
        reference: The reference to follow. Each plan has its own instance, whose identity shows
            which plan a stored tau belongs to.
        field: The field that follows the reference: the planner's `field`, or, if the kind is OFF,
            the field that was passed to the planner.
        kind: How the demonstration is entered.
        guide: (K, 4, 4) poses X_WB that the object passes until it is on the reference. It is empty
            if the reference begins at the object, and once the object is on the reference.
    """

    reference: PointTrajectory
    field: BcsdmConfig
    kind: EntryKind
    guide: np.ndarray

    def __post_init__(self) -> None:
        freeze_fields(self, guide=("K", 4, 4))


class SafeEntryPlanner:
    """Plans paths onto the reference that keep the required clearance to the scene.

    The planner uses the first of these paths that is free:

    1. the field itself, rolled out;
    2. a straight motion, first to the samples of the reference that keep the margin, in order of
       their distance, then to the nearest of all samples;
    3. a path found by RRT-Connect to one of the samples that keep the margin.

    Attributes:
        model: Object, scene and reference.
        field: The field that follows the plans: the one passed to the constructor, with a progress
            window unless safe entry is switched off.
    """

    def __init__(
        self,
        *,
        reference: PointTrajectory,
        scene: SceneCloud,
        object_cloud: np.ndarray,
        object_points: np.ndarray,
        bcsdm: BcsdmConfig | None = None,
        config: SafeEntryConfig | None = None,
    ):
        """Measures the clearance along the reference.

        Args:
            reference: The demonstrated trajectory of the N tracked points.
            scene: The obstacles, without the object, the hand and the arm.
            object_cloud: (Q, 3) surface of the object at one time [m, world].
            object_points: (N, 3) the points at that time [m, world]; NaN where not observed.
            bcsdm: The field; None for the defaults.
            config: Clearance and effort; None for the defaults.

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
                self._unguarded, progress_window=_PROGRESS_WINDOW, window_escape_ratio=0.0
            )

    def unguarded(self) -> EntryPlan:
        """Returns the plan to follow the demonstration with the field given to the constructor."""
        return EntryPlan(replace(self.model.reference), self._unguarded, EntryKind.OFF, _NO_GUIDE)

    def plan(
        self,
        points: np.ndarray,
        confidence: np.ndarray | None = None,
        *,
        seed: int = 0,
        avoid_field: bool = False,
    ) -> EntryPlan:
        """Returns a plan that leads from the points to the demonstration's end.

        Args:
            points: (N, 3) [m, world]; NaN where not observed.
            confidence: (N,) weights in [0, 1]; None for all equal.
            seed: Seed of the search. The result depends only on the arguments.
            avoid_field: Whether to skip the field itself, because it turned out to be blocked.

        Raises:
            PlanningError: if no path is found.
            TrackingError: if fewer than three points are observed.
        """
        if not self._config.enabled:
            return self.unguarded()
        model, config = self.model, self._config
        start = model.start(points, confidence)
        if not avoid_field:
            ahead = roll_out_entry(model, start, model.reference, self.field)
            if ahead is not None:
                return EntryPlan(replace(model.reference), self.field, EntryKind.FIELD, ahead)
        candidates = entry_candidates(model, start)
        kind = EntryKind.STRAIGHT
        transit = straight_transit(model, start, candidates)
        if transit is None:
            kind = EntryKind.SEARCHED
            transit = searched_transit(model, start, candidates, config.transit, seed)
        if transit is None:
            raise PlanningError(
                "No path onto the reference was found for the object at "
                f"{np.round(start.X_WB[:3, 3], 3).tolist()} m, where its clearance is "
                f"{1e3 * min(start.clearance, start.height):.0f} mm; the search took "
                f"{config.transit.iterations} rounds for each of {config.transit.goals} goals.",
                remedy="Move the object or the obstacles, or, in the configuration of safe "
                "entry, lower clearance.margin or raise transit.iterations.",
            )
        reference = extended_reference(model.reference, *transit)
        return EntryPlan(reference, self.field, kind, _NO_GUIDE)

    def check(
        self,
        plan: EntryPlan,
        points: np.ndarray,
        tau: float,
        confidence: np.ndarray | None = None,
    ) -> EntryPlan | None:
        """Returns the plan to continue with; None if the given plan is no longer safe.

        The planned path consists of the reference's pose at tau and the rest of the guide. If the
        object is within `on_way` of this path, or within the uncertainty of its pose, the plan is
        kept without the guide's poses that the object has passed. If the object is within
        `tube_radius`, the field is rolled out from its pose. If the field leads back without a
        collision, the plan is kept with the rolled-out path as its guide. In all other cases the
        plan is no longer safe.

        Args:
            plan: The plan being followed.
            points: (N, 3) [m, world]; NaN where not observed.
            tau: Time of the closest configuration on the plan's reference [s].
            confidence: (N,) weights in [0, 1]; None for all equal.

        Raises:
            TrackingError: if fewer than three points are observed.
        """
        if plan.kind is EntryKind.OFF:
            return plan
        model, config = self.model, self._config
        start = model.start(points, confidence)
        here = model.pose(plan.reference.positions_at(tau))[None]
        path = np.concatenate([here, plan.guide])
        deviations = model.displacement(start.X_WB[None], path)[0]
        (passed,) = np.nonzero(deviations <= max(config.on_way, start.uncertainty))
        if passed.size:
            # The first pose that is close enough, because a guide may come near itself.
            guide = plan.guide[passed[0] - 1 :] if passed[0] > 0 else _NO_GUIDE
            return plan if len(guide) == len(plan.guide) else replace(plan, guide=guide)
        if deviations.min() > config.tube_radius:
            return None
        back = roll_out_entry(model, start, plan.reference, plan.field, tau=tau)
        return None if back is None else replace(plan, guide=back)
