"""Occlusion-aware non-rigid registration of aligned parts (POIL section III-A)."""

import copy
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from poil_drake.errors import TransferError
from poil_drake.geometry.point_cloud import farthest_point_sampling
from poil_drake.transfer.registration.local_reconstruction import local_reconstruction_weights

if TYPE_CHECKING:
    import torch

    from poil_drake.transfer.registration.displacement_network import DisplacementNetwork

# Lengths are in units of the larger part's largest radius.
_NEIGHBOURS = 30  # Number of neighbours that reconstruct a point, as in OAReg's paper.
_REGULARIZATION = 1e-3  # Ridge of the reconstruction weights, relative to their Gram matrix.
_TRUNCATION = 0.2  # Pairs farther apart than this have no counterpart and do not pull.
_SMOOTHING = 0.003
"""Reconstruction errors below this, relative to the clouds' size, count quadratically. With a kink
at zero the optimisation would stay at the identity."""

_STIFFNESS = 200.0
"""Weight of the mean reconstruction error relative to the data term. OAReg (see
`register_non_rigid`) weighs the sum over the points, by 1 to 100."""

_FREQUENCY = 8.0
"""omega_0 of `DisplacementNetwork`. With 30, as in OAReg, the deformation has wrinkles."""

_LEARNING_RATE = 1e-3
_PATIENCE = 20  # Steps without an improvement after which the optimisation ends.
_MIN_IMPROVEMENT = 1e-3  # Of the loss, relative to the initial one.


def register_non_rigid(
    source: np.ndarray,
    target: np.ndarray,
    *,
    carried: np.ndarray | None = None,
    max_points: int = 400,
    max_steps: int = 200,
) -> Callable[[np.ndarray], np.ndarray]:
    """Returns the deformation of a coarsely aligned part onto another.

    The method is OAReg (Zhao, Meng, Yan, ICLR 2025). A network d with sine activations maximises
    the correntropy of nearest neighbours between x + d(x) and the target, in both directions. The
    correntropy is truncated, so that surfaces seen in one view only do not pull. A regulariser
    keeps each point the same linear combination of its neighbours (locally linear reconstruction),
    which affine maps preserve exactly. Three things differ from OAReg:

    - Both clouds share one normalisation, because the coarse alignment has placed them.
    - The deformation starts at the identity.
    - The regulariser penalises the reconstruction error of the displacements. The error of the
      displaced points is large from sensor noise alone; reducing it would contract a noisy cloud.

    Args:
        source: (P, 3) the part to deform, coarsely aligned [m].
        target: (Q, 3) the other part [m].
        carried: (M, 3) points to be deformed with the part [m]; the regulariser includes them.
        max_points: Largest number of points used from each cloud, spread evenly. The computing time
            grows with its square.
        max_steps: Largest number of optimisation steps.

    Returns:
        A function that maps points (R, 3) of the source to points (R, 3) on the target [m].

    Raises:
        TransferError: if a cloud has fewer than 4 points, or the optimisation diverges.
    """
    for name, cloud in (("demonstrated", source), ("target", target)):
        if len(cloud) < 4:
            raise TransferError(
                f"The cloud of the {name} part has {len(cloud)} points; 4 are needed to deform it.",
                remedy="Move a camera nearer to the part.",
            )
    center = target.mean(axis=0)
    length = float(max(np.linalg.norm(c - center, axis=1).max() for c in (source, target)))
    data, goal = (_spread((c - center) / length, max_points) for c in (source, target))
    extra = np.empty((0, 3)) if carried is None else (carried - center) / length
    network = _optimize(data, goal, extra, max_steps)

    def deform(points: np.ndarray) -> np.ndarray:
        return points + length * network.displacements((points - center) / length)

    return deform


def deform_points(source: np.ndarray, target: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Returns points (M, 3) of the source, carried along by `register_non_rigid` [m]."""
    return register_non_rigid(source, target, carried=points)(points)


def _spread(points: np.ndarray, count: int) -> np.ndarray:
    return points[farthest_point_sampling(points, min(count, len(points)))]


def _optimize(
    source: np.ndarray,
    target: np.ndarray,
    extra: np.ndarray,
    max_steps: int,
) -> "DisplacementNetwork":
    import torch

    from poil_drake.transfer.registration.adam import Adam
    from poil_drake.transfer.registration.displacement_network import DisplacementNetwork

    batch = np.concatenate([source, extra])
    neighbours, weights = local_reconstruction_weights(
        batch, neighbours=_NEIGHBOURS, regularization=_REGULARIZATION
    )
    network = DisplacementNetwork(hidden_units=128, hidden_layers=3, frequency=_FREQUENCY, seed=0)
    x, goal = (torch.as_tensor(p, dtype=torch.float32) for p in (batch, target))
    j = torch.as_tensor(neighbours)
    w = torch.as_tensor(weights, dtype=torch.float32)
    optimizer = Adam(network.parameters(), learning_rate=_LEARNING_RATE)
    best, best_step, losses = copy.deepcopy(network.state_dict()), 0, list[float]()
    for step in range(max_steps + 1):
        d = network(x)
        squares = (d - (w[..., None] * d[j]).sum(dim=1)).square().sum(dim=1)
        bend = torch.sqrt(squares + _SMOOTHING**2) - _SMOOTHING
        loss = _data_term((x + d)[: len(source)], goal) + _STIFFNESS * bend.mean()
        losses.append(float(loss.detach()))
        if step > 0 and losses[-1] < min(losses[:-1]):
            best = copy.deepcopy(network.state_dict())
        if losses[-1] < losses[best_step] - _MIN_IMPROVEMENT * abs(losses[0]):
            best_step = step
        if step - best_step >= _PATIENCE or step == max_steps:
            break
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    if not np.isfinite(losses[-1]):
        raise TransferError(
            f"The non-rigid registration diverged: its loss is {losses[-1]}.",
            remedy="Check the part's mask and depth in the demonstration and in the scene.",
        )
    network.load_state_dict(best)
    return network


def _data_term(y: "torch.Tensor", target: "torch.Tensor") -> "torch.Tensor":
    """Returns the negative correntropy of deformed points y and the target, in both directions."""
    import torch

    with torch.no_grad():
        squares = torch.cdist(y, target)
        nearest_target, nearest_source = squares.argmin(dim=1), squares.argmin(dim=0)
    term = y.new_zeros(())
    for a, b in ((y, target[nearest_target]), (y[nearest_source], target)):
        distance = torch.linalg.norm(a - b + 1e-12, dim=1)
        term = term - torch.exp(-torch.where(distance < _TRUNCATION, distance, _TRUNCATION)).mean()
    return term
