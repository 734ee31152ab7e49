"""A cost that keeps the part joined to the rest of the object."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from poil_drake.geometry.point_cloud import PointCloud
from poil_drake.transfer.alignment.cloud_term import CloudTerm
from poil_drake.transfer.alignment.state import UNKNOWNS, AlignmentState, NormalEquations

_REACH = 0.4
"""Part and rest join where they are closer than this, in units of the part's `CloudFrame.length`.
They do not touch, because masks are eroded."""

_MAX_POINTS = 40
_CAP = 3.0  # Offset, in standard deviations, at which the cost reaches half of its limit.


@dataclass(frozen=True, eq=False)
class JoinTerm:
    """Makes the transforms of part and rest agree where the two join.

    Part and rest have their own scales and translations. The demonstrated part's points that are
    close to the rest are moved by both transforms. The two results should agree perpendicular to
    the surface of the rest, but may differ along it, because handles sit higher or lower. The term
    is robust (Geman-McClure): large offsets pull less and less.

    Attributes:
        part: The part's term, whose `place` applies the part's transform.
        context: The term of the rest, whose `place` applies the transform of the rest.
        part_points: (n, 3) the joining points in the part's `CloudFrame`.
        context_points: (n, 3) the same points in the context's `CloudFrame`.
        normals: (n, 3) the unit normals of the rest at these points.
        across: Standard deviation of the offset across the surface, in units of the part's
            `CloudFrame.length`.
        along: Standard deviation of the offset along the surface, in the same units.
    """

    part: CloudTerm
    context: CloudTerm
    part_points: np.ndarray
    context_points: np.ndarray
    normals: np.ndarray
    across: float = 0.1
    along: float = 0.4

    @classmethod
    def between(
        cls,
        part_term: CloudTerm,
        context_term: CloudTerm,
        *,
        part: PointCloud,
        context: PointCloud,
    ) -> "JoinTerm | None":
        """Returns the term, or None if the part is nowhere close to the rest.

        Args:
            part_term: The part's term.
            context_term: The term of the rest.
            part: The demonstrated part.
            context: The rest of the demonstrated object; without normals the result is None.
        """
        if context.normals is None:
            return None
        distances, nearest = cKDTree(context.points).query(part.points)
        joining = np.flatnonzero(distances < _REACH * part_term.frame.length)
        if joining.size == 0:
            return None
        joining = joining[:: -(-joining.size // _MAX_POINTS)]
        points = part.points[joining]
        frames = part_term.frame, context_term.frame
        in_part, in_context = ((points - f.source_center) / f.length for f in frames)
        return cls(part_term, context_term, in_part, in_context, context.normals[nearest[joining]])

    def energy(self, state: AlignmentState) -> np.ndarray:
        """Returns the energies (K,): half of the mean squared offset in standard deviations.

        Large offsets are robustly capped.
        """
        residual, _ = self._residual(state)
        squares = np.sum(residual**2, axis=2)
        return 0.5 * np.mean(squares / (1.0 + squares / _CAP**2), axis=1)

    def linearize(self, state: AlignmentState, weight: float, equations: NormalEquations) -> None:
        """Adds the Gauss-Newton approximation of `weight` times the energy to `equations`."""
        residual, jacobian = self._residual(state)
        squares = np.sum(residual**2, axis=2)
        robust = weight / residual.shape[1] / (1.0 + squares / _CAP**2) ** 2
        equations.add(np.arange(UNKNOWNS), jacobian, residual, robust)

    def _residual(self, state: AlignmentState) -> tuple[np.ndarray, np.ndarray]:
        part_points, part_jacobian = self.part.place(state, self.part_points)
        context_points, context_jacobian = self.context.place(state, self.context_points)
        ratio = self.context.frame.length / self.part.frame.length
        gap = self.context.frame.target_center - self.part.frame.target_center
        offset = part_points - context_points * ratio - gap / self.part.frame.length
        jacobian = np.concatenate([part_jacobian, -ratio * context_jacobian[..., 3:]], axis=3)
        jacobian[..., 0:3] -= ratio * context_jacobian[..., 0:3]
        normals = self.normals @ np.swapaxes(state.R, 1, 2)
        outer = normals[..., :, None] * normals[..., None, :]
        whiten = np.eye(3) / self.along + outer * (1.0 / self.across - 1.0 / self.along)
        return (whiten @ offset[..., None])[..., 0], whiten @ jacobian
