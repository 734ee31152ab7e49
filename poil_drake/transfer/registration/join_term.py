"""Keeps the part joined to the rest of the object."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from poil_drake.geometry.point_cloud import PointCloud
from poil_drake.transfer.alignment.cloud_term import CloudFrame, CloudTerm
from poil_drake.transfer.alignment.state import AlignmentState, NormalEquations

_COLUMNS = np.arange(15)


@dataclass(frozen=True, eq=False)
class JoinTerm:
    """Where the part joins the rest of the object, both transforms must agree.

    The part and the rest have scales and translations of their own. A point of the demonstrated
    part that lies close to the rest is carried by both; across the rest's surface the results must
    coincide, along it they may differ, because handles sit higher or lower. Robust: offsets of many
    deviations pull less and less (Geman-McClure).

    Attributes:
        part: The part's term, which places points.
        context: The rest's.
        part_points: (n, 3) the joining points in the part's units.
        context_points: (n, 3) the same points in the context's units.
        normals: (n, 3) the rest's normals there.
        across: Standard deviation of the offset across the surface, in the part's lengths.
        along: The same along it.
    """

    part: CloudTerm
    context: CloudTerm
    part_points: np.ndarray
    context_points: np.ndarray
    normals: np.ndarray
    across: float
    along: float

    @classmethod
    def between(
        cls,
        part_term: CloudTerm,
        context_term: CloudTerm,
        *,
        part: PointCloud,
        context: PointCloud,
        reach: float,
        across: float,
        along: float,
        max_points: int = 40,
    ) -> "JoinTerm | None":
        """Returns the term, None where the part nowhere comes near the rest.

        Args:
            part_term: Places the part.
            context_term: Places the rest.
            part: The demonstrated part.
            context: The rest of the demonstrated object, with normals.
            reach: How near they come where they join, in the part's lengths. Detectors' masks are
                eroded, which leaves a gap.
            across: See the attribute.
            along: See the attribute.
            max_points: At most this many points are used.
        """
        if context.normals is None:
            return None
        distances, nearest = cKDTree(context.points).query(part.points)
        joining = np.flatnonzero(distances < reach * part_term.frame.length)
        if joining.size == 0:
            return None
        joining = joining[:: -(-joining.size // max_points)]
        points = part.points[joining]

        def local(frame: CloudFrame) -> np.ndarray:
            return (points - frame.source_center) / frame.length

        return cls(
            part_term,
            context_term,
            local(part_term.frame),
            local(context_term.frame),
            context.normals[nearest[joining]],
            across,
            along,
        )

    def energy(self, state: AlignmentState) -> np.ndarray:
        """Returns half the mean robust squared offset (K,), in deviations."""
        residual, _ = self._residual(state)
        squares = np.sum(residual**2, axis=2)
        return 0.5 * np.mean(squares / (1.0 + squares / _CAP**2), axis=1)

    def linearize(self, state: AlignmentState, weight: float, equations: NormalEquations) -> None:
        """Adds the Gauss-Newton approximation of weight times the energy."""
        residual, jacobian = self._residual(state)
        squares = np.sum(residual**2, axis=2)
        robust = weight / residual.shape[1] / (1.0 + squares / _CAP**2) ** 2
        equations.add(_COLUMNS, jacobian, residual, robust)

    def _residual(self, state: AlignmentState) -> tuple[np.ndarray, np.ndarray]:
        part = self.part.place(state, self.part_points)
        context = self.context.place(state, self.context_points)
        ratio = self.context.frame.length / self.part.frame.length
        gap = self.context.frame.target_center - self.part.frame.target_center
        offset = part.points - context.points * ratio - gap / self.part.frame.length
        jacobian = np.concatenate([part.jacobian, -ratio * context.jacobian[..., 3:]], axis=3)
        jacobian[..., 0:3] -= ratio * context.jacobian[..., 0:3]
        normals = self.normals @ np.swapaxes(state.R, 1, 2)
        outer = normals[..., :, None] * normals[..., None, :]
        whiten = np.eye(3) / self.along + outer * (1.0 / self.across - 1.0 / self.along)
        return (whiten @ offset[..., None])[..., 0], whiten @ jacobian


_CAP = 3.0  # deviations at which an offset begins to pull less
