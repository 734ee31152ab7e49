"""Occlusion-aware non-rigid registration of aligned parts (POIL section III-A)."""

import copy
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from poil_drake.errors import TransferError
from poil_drake.geometry.point_cloud import farthest_point_sampling

if TYPE_CHECKING:
    import torch

    from poil_drake.transfer.registration_network import DisplacementNetwork

# Lengths are in units of the larger part's largest radius.
_NEIGHBOURS = 30  # Number of neighbours that reconstruct a point, as in OAReg's paper.
_REGULARIZATION = 1e-3  # Ridge of the reconstruction weights, relative to their Gram matrix.
_TRUNCATION = 0.2  # Pairs farther apart than this have no counterpart and do not pull.
_SMOOTHING = 0.003
"""Reconstruction errors below this, relative to the clouds' size, count quadratically. With a kink
at zero the optimisation would stay at the identity."""

_STIFFNESS = 200.0
"""Weight of the mean reconstruction error relative to the data term. OAReg (see
`deform_points`) weighs the sum over the points, by 1 to 100."""

_LEARNING_RATE = 1e-3
_MAX_POINTS = 400  # Of each cloud, spread evenly; the computing time grows with its square.
_MAX_STEPS = 200
_PATIENCE = 20  # Steps without an improvement after which the optimisation ends.
_MIN_IMPROVEMENT = 1e-3  # Of the loss, relative to the initial one.


def deform_points(source: np.ndarray, target: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Returns where the deformation of a coarsely aligned part onto another takes points.

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
        points: (M, 3) points of the source [m]; the regulariser includes them.

    Returns:
        The points (M, 3) on the target [m].

    Raises:
        TransferError: if the optimisation diverges.
    """
    center = target.mean(axis=0)
    length = float(max(np.linalg.norm(c - center, axis=1).max() for c in (source, target)))
    data, goal = (_spread((c - center) / length) for c in (source, target))
    carried = (points - center) / length
    return points + length * _optimize(data, goal, carried).displacements(carried)


def _spread(points: np.ndarray) -> np.ndarray:
    return points[farthest_point_sampling(points, min(_MAX_POINTS, len(points)))]


def _optimize(source: np.ndarray, target: np.ndarray, carried: np.ndarray) -> "DisplacementNetwork":
    import torch

    from poil_drake.transfer.registration_network import Adam, DisplacementNetwork

    batch = np.concatenate([source, carried])
    neighbours, weights = local_reconstruction_weights(
        batch, neighbours=_NEIGHBOURS, regularization=_REGULARIZATION
    )
    network = DisplacementNetwork()
    x, goal = (torch.as_tensor(p, dtype=torch.float32) for p in (batch, target))
    j = torch.as_tensor(neighbours)
    w = torch.as_tensor(weights, dtype=torch.float32)
    optimizer = Adam(network.parameters(), learning_rate=_LEARNING_RATE)
    best, best_step, losses = copy.deepcopy(network.state_dict()), 0, list[float]()
    for step in range(_MAX_STEPS + 1):
        d = network(x)
        squares = (d - (w[..., None] * d[j]).sum(dim=1)).square().sum(dim=1)
        bend = torch.sqrt(squares + _SMOOTHING**2) - _SMOOTHING
        loss = _data_term((x + d)[: len(source)], goal) + _STIFFNESS * bend.mean()
        losses.append(float(loss.detach()))
        if step > 0 and losses[-1] < min(losses[:-1]):
            best = copy.deepcopy(network.state_dict())
        if losses[-1] < losses[best_step] - _MIN_IMPROVEMENT * abs(losses[0]):
            best_step = step
        if step - best_step >= _PATIENCE or step == _MAX_STEPS:
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


def local_reconstruction_weights(
    points: np.ndarray, *, neighbours: int, regularization: float
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the neighbours of each point and the weights that reconstruct it from them.

    Locally linear embedding (Roweis and Saul, Science 2000): minimises |x_i - sum_j w_ij x_j|^2
    with sum_j w_ij = 1. The weights are invariant to affine maps of the cloud.

    Args:
        points: (P, 3) the cloud, P >= 2.
        neighbours: Number of neighbours, without the point itself; at most P - 1 are used.
        regularization: Ridge relative to the trace of the neighbourhood's Gram matrix.

    Returns:
        indices: (P, k) the neighbours.
        weights: (P, k) the weights; each row adds up to 1.
    """
    k = min(neighbours, len(points) - 1)
    _, indices = cKDTree(points).query(points, k=k + 1)
    # Where points coincide, the point itself need not be the first.
    is_self = indices == np.arange(len(points))[:, None]
    is_self[~is_self.any(axis=1), -1] = True
    indices = indices[~is_self].reshape(len(points), k)
    arms = points[indices] - points[:, None]
    gram = arms @ np.swapaxes(arms, 1, 2)
    ridge = regularization * np.trace(gram, axis1=1, axis2=2)
    gram = gram + np.maximum(ridge, 1e-15)[:, None, None] * np.eye(k)
    weights = np.linalg.solve(gram, np.ones((len(points), k, 1)))[..., 0]
    return indices, weights / weights.sum(axis=1, keepdims=True)
