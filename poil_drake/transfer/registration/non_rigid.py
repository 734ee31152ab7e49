"""Occlusion-aware non-rigid registration of aligned parts (POIL section III-A)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from poil_drake.errors import InvalidValueError, TransferError
from poil_drake.geometry.sampling import farthest_point_sampling
from poil_drake.transfer.registration.local_reconstruction import local_reconstruction_weights

if TYPE_CHECKING:
    import torch

    from poil_drake.transfer.registration.displacement_network import DisplacementNetwork

Progress = Callable[[str, float], None]
"""Called with what is being done and the fraction of it that is done."""


@dataclass(frozen=True, kw_only=True)
class NonRigidConfig:
    """How parts are deformed. Lengths are in units of the larger part's largest radius.

    Attributes:
        max_points: At most this many points of each cloud are used, spread evenly; the time grows
            with their product.
        neighbours: How many neighbours a point is reconstructed from (the paper of OAReg: 30).
        regularization: Ridge of the reconstruction weights, relative to their Gram matrix.
        stiffness: Weight of the mean reconstruction error relative to the mean data term. OAReg
            weighs a sum over points 1 to 100 against a mean; a mean does not depend on how many
            points there are, and 50 is the same at 5000 points.
        smoothing: Reconstruction errors below this count quadratically: with a kink at zero the
            optimisation would stay at the identity.
        truncation: Pairs farther apart than this have no counterpart and do not pull.
        bandwidth: Of the correntropy, exp(-d / bandwidth). At 1, within the truncation, distances
            count about linearly.
        hidden_units: Width of the network.
        hidden_layers: Its sine layers after the first.
        frequency: omega_0 of the sine layers. OAReg's 30 fits wrinkles to clouds of some hundred
            points.
        learning_rate: Of Adam.
        max_steps: At most this many steps.
        patience: Ends after so many steps without an improvement of `min_improvement`.
        min_improvement: Of the loss, relative.
        seed: Of the network's first weights.
    """

    max_points: int = 400
    neighbours: int = 30
    regularization: float = 1e-3
    stiffness: float = 200.0
    smoothing: float = 0.003
    truncation: float = 0.2
    bandwidth: float = 1.0
    hidden_units: int = 128
    hidden_layers: int = 3
    frequency: float = 8.0
    learning_rate: float = 1e-3
    max_steps: int = 200
    patience: int = 20
    min_improvement: float = 1e-3
    seed: int = 0

    def __post_init__(self) -> None:
        if not (self.truncation > 0.0 and self.bandwidth > 0.0 and self.stiffness >= 0.0):
            raise InvalidValueError(
                f"NonRigidConfig has truncation={self.truncation}, bandwidth={self.bandwidth} and "
                f"stiffness={self.stiffness}.",
                remedy="Truncation and bandwidth must be positive, the stiffness not negative.",
            )


@dataclass(frozen=True, eq=False)
class DisplacementField:
    """Carries points of the deformed part.

    Attributes:
        network: The displacement, in normalised coordinates.
        center: (3,) origin of these coordinates [m].
        length: Their unit [m].
        steps: How many steps the optimisation took.
        initial_loss: The loss of the identity.
        final_loss: The loss of this field.
    """

    network: "DisplacementNetwork"
    center: np.ndarray
    length: float
    steps: int
    initial_loss: float
    final_loss: float

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Returns points (P, 3) [m] where the field carries them (P, 3) [m]."""
        local = (np.asarray(points, dtype=float) - self.center) / self.length
        return points + self.length * self.network.displacements(local)


def register_non_rigid(
    source: np.ndarray,
    target: np.ndarray,
    *,
    carried: np.ndarray | None = None,
    config: NonRigidConfig | None = None,
    progress: Progress | None = None,
) -> DisplacementField:
    """Returns the displacement field that deforms a coarsely aligned part onto another.

    Written from the formulas of OAReg (Zhao, Meng, Yan, ICLR 2025): the field x + d(x), d a network
    with sine activations, maximises the correntropy of nearest neighbours in both directions,
    truncated so that what one view does not show pulls nothing, while each point stays the same
    linear combination of its neighbours (locally linear reconstruction), which affine maps keep
    exactly. Unlike there, both clouds share one normalisation, since the coarse alignment already
    placed them; the network starts at the identity; and the reconstruction error of the
    displacement counts, not that of the displaced points, which sensor noise alone makes large:
    reducing it would pull a noisy cloud together.

    Args:
        source: (P, 3) the part to deform, coarsely aligned [m].
        target: (Q, 3) the other part [m].
        carried: (M, 3) points that will be carried [m]; they join the source in the regulariser.
        config: Parameters, None for the defaults.
        progress: Told how far the optimisation is.

    Raises:
        TransferError: if a cloud has fewer points than a neighbourhood needs, or the optimisation
            diverges.
    """
    config = config or NonRigidConfig()
    for name, cloud in (("demonstrated", source), ("target", target)):
        if len(cloud) < 4:
            raise TransferError(
                f"The {name} part has {len(cloud)} points; 4 are needed to deform it.",
                remedy="Bring a camera nearer, or lower the voxel size.",
            )
    center = target.mean(axis=0)
    length = float(max(np.linalg.norm(c - center, axis=1).max() for c in (source, target)))
    data, goal = (_spread((c - center) / length, config.max_points) for c in (source, target))
    extra = np.empty((0, 3)) if carried is None else (carried - center) / length
    network, losses = _optimize(data, goal, extra, config, progress)
    if not np.isfinite(losses[-1]):
        raise TransferError(
            "The non-rigid registration diverged.",
            remedy="Lower NonRigidConfig.learning_rate.",
        )
    return DisplacementField(network, center, length, len(losses) - 1, losses[0], min(losses))


def _spread(points: np.ndarray, count: int) -> np.ndarray:
    return points[farthest_point_sampling(points, min(count, len(points)))]


def _optimize(
    source: np.ndarray,
    target: np.ndarray,
    extra: np.ndarray,
    config: NonRigidConfig,
    progress: Progress | None,
) -> tuple["DisplacementNetwork", list[float]]:
    import torch

    from poil_drake.transfer.registration.adam import Adam
    from poil_drake.transfer.registration.displacement_network import DisplacementNetwork

    batch = np.concatenate([source, extra])
    neighbours, weights = local_reconstruction_weights(
        batch, neighbours=config.neighbours, regularization=config.regularization
    )
    network = DisplacementNetwork(
        hidden_units=config.hidden_units,
        hidden_layers=config.hidden_layers,
        frequency=config.frequency,
        seed=config.seed,
    )
    x, goal = (torch.as_tensor(p, dtype=torch.float32) for p in (batch, target))
    j = torch.as_tensor(neighbours)
    w = torch.as_tensor(weights, dtype=torch.float32)
    optimizer = Adam(network.parameters(), learning_rate=config.learning_rate)
    best, best_step, losses = network.snapshot(), 0, []
    for step in range(config.max_steps + 1):
        d = network(x)
        squares = (d - (w[..., None] * d[j]).sum(dim=1)).square().sum(dim=1)
        bend = torch.sqrt(squares + config.smoothing**2) - config.smoothing
        loss = _data_term((x + d)[: len(source)], goal, config) + config.stiffness * bend.mean()
        losses.append(float(loss.detach()))
        if step == 0 or losses[-1] < min(losses[:-1]):
            best = network.snapshot()
        if step == 0 or losses[-1] < losses[best_step] - config.min_improvement * abs(losses[0]):
            best_step = step
        if step - best_step >= config.patience or step == config.max_steps:
            break
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        if progress is not None:
            progress("deforming the part", (step + 1) / config.max_steps)
    network.restore(best)
    if progress is not None:
        progress("deforming the part", 1.0)
    return network, losses


def _data_term(y: "torch.Tensor", target: "torch.Tensor", config: NonRigidConfig) -> "torch.Tensor":
    """Returns minus the mean correntropy of nearest neighbours, truncated, in both directions."""
    import torch

    with torch.no_grad():
        squares = torch.cdist(y, target)
        nearest_target, nearest_source = squares.argmin(dim=1), squares.argmin(dim=0)
    term = y.new_zeros(())
    for a, b in ((y, target[nearest_target]), (y[nearest_source], target)):
        distance = torch.linalg.norm(a - b + 1e-12, dim=1)
        kept = torch.where(distance < config.truncation, distance, config.truncation)
        term = term - torch.exp(-kept / config.bandwidth).mean()
    return term
