"""The unknowns of the coarse alignment, for many candidates at once."""

from dataclasses import dataclass, replace

import numpy as np

from poil_drake.geometry.rigid_transform import rotation_exp

ROTATION = np.arange(0, 3)
"""Columns of the unknowns that turn both clouds [rad, world]."""

PART = np.arange(3, 9)
"""Columns of the part's logarithmic scales (3) and translation (3)."""

CONTEXT = np.arange(9, 15)
"""Columns of the context's logarithmic scales (3) and translation (3)."""

UNKNOWNS = 15


@dataclass(frozen=True, eq=False)
class AlignmentState:
    """K candidates. One rotation turns part and context; each has scales and a translation.

    Attributes:
        R: (K, 3, 3) rotations.
        log_scales: (K, 2, 3) logarithms of the scales, of the part and of the context.
        translations: (K, 2, 3) translations, each in the length of its own cloud.
    """

    R: np.ndarray
    log_scales: np.ndarray
    translations: np.ndarray

    @classmethod
    def start(cls, rotations: np.ndarray) -> "AlignmentState":
        """Returns candidates that match centroids, without scaling."""
        zeros = np.zeros((len(rotations), 2, 3))
        return cls(rotations, zeros, zeros)

    def __len__(self) -> int:
        return len(self.R)

    def select(self, which: np.ndarray) -> "AlignmentState":
        """Returns the candidates of these indices."""
        return AlignmentState(self.R[which], self.log_scales[which], self.translations[which])

    def moved(
        self, step: np.ndarray, *, max_turn: float, log_scale_bounds: tuple[float, float]
    ) -> "AlignmentState":
        """Returns the candidates after a step.

        Args:
            step: (K, UNKNOWNS). Longer turns are shortened, and the whole step with them.
            max_turn: The longest turn about an axis [rad].
            log_scale_bounds: Scales are clipped to these.
        """
        largest = np.abs(step[:, ROTATION]).max(axis=1)
        step = step * np.minimum(1.0, max_turn / np.maximum(largest, 1e-12))[:, None]
        own = np.stack([step[:, PART], step[:, CONTEXT]], axis=1)
        return replace(
            self,
            R=rotation_exp(step[:, ROTATION]) @ self.R,
            log_scales=np.clip(self.log_scales + own[..., :3], *log_scale_bounds),
            translations=self.translations + own[..., 3:],
        )


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Gauss-Newton normal equations H step = -g of K candidates, summed up term by term.

    Attributes:
        H: (K, UNKNOWNS, UNKNOWNS).
        g: (K, UNKNOWNS).
    """

    H: np.ndarray
    g: np.ndarray

    @classmethod
    def zero(cls, count: int) -> "NormalEquations":
        """Returns equations without any term."""
        return cls(np.zeros((count, UNKNOWNS, UNKNOWNS)), np.zeros((count, UNKNOWNS)))

    def add(
        self, columns: np.ndarray, jacobian: np.ndarray, residual: np.ndarray, weight: np.ndarray
    ) -> None:
        """Adds sum_i w_i |r_i|^2 / 2.

        Args:
            columns: (c,) which unknowns the Jacobian is about.
            jacobian: (K, n, d, c).
            residual: (K, n, d).
            weight: (K, n).
        """
        K, c = len(self.g), len(columns)
        J = jacobian.reshape(K, -1, c)
        weighted = np.swapaxes((jacobian * weight[..., None, None]).reshape(K, -1, c), 1, 2)
        self.H[:, columns[:, None], columns] += weighted @ J
        self.g[:, columns] += (weighted @ residual.reshape(K, -1, 1))[..., 0]

    def solve(self, damping: float) -> np.ndarray:
        """Returns the step (K, UNKNOWNS); `damping` keeps undetermined unknowns where they are."""
        H = self.H + damping * np.eye(UNKNOWNS)
        return -np.linalg.solve(H, self.g[..., None])[..., 0]
