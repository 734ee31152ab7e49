"""The unknowns of the coarse alignment, for many candidates at once."""

from dataclasses import dataclass

import numpy as np

from poil_drake.geometry.rigid_transform import rotation_exp

UNKNOWNS = 15
"""Number of unknowns: a rotation of both clouds (3) [rad, world], then the logarithmic scales (3)
and the translation (3) of the part, then the scales (3) and the translation (3) of the context."""

_MAX_TURN = 0.4  # [rad] Largest rotation about an axis in one step.
_LOG_SCALE_BOUNDS = np.log([0.6, 1.7])  # Of the scale along a principal axis.


@dataclass(frozen=True, eq=False)
class AlignmentState:
    """K candidate alignments of the part and of its context, the rest of the object.

    Part and context share the rotation. Each has its own scales and translation.

    Attributes:
        R: (K, 3, 3) rotations.
        log_scales: (K, 2, 3) logarithms of the scales, of the part and of the context.
        translations: (K, 2, 3) translations of the part and of the context, each in units of its
            `CloudFrame.length`.
    """

    R: np.ndarray
    log_scales: np.ndarray
    translations: np.ndarray

    @classmethod
    def start(cls, rotations: np.ndarray) -> "AlignmentState":
        """Returns candidates with rotations (K, 3, 3), unit scales and coinciding centroids."""
        zeros = np.zeros((len(rotations), 2, 3))
        return cls(rotations, zeros, zeros)

    def __len__(self) -> int:
        return len(self.R)

    def select(self, which: np.ndarray) -> "AlignmentState":
        """Returns the candidates with these indices."""
        return AlignmentState(self.R[which], self.log_scales[which], self.translations[which])

    def moved(self, step: np.ndarray) -> "AlignmentState":
        """Returns the candidates after a step (K, UNKNOWNS) of the unknowns.

        A step that turns too far is shortened as a whole, and scales are kept within bounds.
        """
        largest = np.abs(step[:, :3]).max(axis=1)
        step = step * np.minimum(1.0, _MAX_TURN / np.maximum(largest, 1e-12))[:, None]
        own = step[:, 3:].reshape(-1, 2, 6)
        return AlignmentState(
            rotation_exp(step[:, :3]) @ self.R,
            np.clip(self.log_scales + own[..., :3], *_LOG_SCALE_BOUNDS),
            self.translations + own[..., 3:],
        )


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Gauss-Newton normal equations H step = -g of K candidates, summed over the cost's terms.

    Attributes:
        H: (K, UNKNOWNS, UNKNOWNS) approximate Hessians of the cost.
        g: (K, UNKNOWNS) gradients of the cost.
    """

    H: np.ndarray
    g: np.ndarray

    @classmethod
    def zero(cls, count: int) -> "NormalEquations":
        """Returns the equations of `count` candidates for a cost without any term."""
        return cls(np.zeros((count, UNKNOWNS, UNKNOWNS)), np.zeros((count, UNKNOWNS)))

    def add(
        self, columns: np.ndarray, jacobian: np.ndarray, residual: np.ndarray, weight: np.ndarray
    ) -> None:
        """Adds the term sum_i w_i |r_i|^2 / 2 of the cost.

        Args:
            columns: (c,) indices of the unknowns on which the residuals depend.
            jacobian: (K, n, d, c) derivatives of the residuals in these unknowns.
            residual: (K, n, d) residuals r_i.
            weight: (K, n) weights w_i.
        """
        K, c = len(self.g), len(columns)
        J = jacobian.reshape(K, -1, c)
        weighted = np.swapaxes((jacobian * weight[..., None, None]).reshape(K, -1, c), 1, 2)
        self.H[:, columns[:, None], columns] += weighted @ J
        self.g[:, columns] += (weighted @ residual.reshape(K, -1, 1))[..., 0]

    def solve(self, damping: float) -> np.ndarray:
        """Returns the steps (K, UNKNOWNS), with `damping` added to the diagonal of H."""
        H = self.H + damping * np.eye(UNKNOWNS)
        return -np.linalg.solve(H, self.g[..., None])[..., 0]
