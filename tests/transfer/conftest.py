"""Point clouds of handles and of a cup."""

from collections.abc import Callable

import numpy as np
import pytest

from poil_drake.geometry.point_cloud import PointCloud

HANDLE_WIDTH, HANDLE_HEIGHT, TUBE = 0.034, 0.058, 0.008
BODY_RADIUS, BODY_HEIGHT = 0.04, 0.09


def handle_line(shape: str, count: int) -> np.ndarray:
    """Returns a handle's centre line (count, 3), which protrudes along +x in the x-z plane [m]."""
    angle = np.linspace(np.pi / 2, -np.pi / 2, count)
    x, z = HANDLE_WIDTH * np.cos(angle), HANDLE_HEIGHT / 2 * np.sin(angle)
    if shape == "ear":
        x = x * (1.0 + 0.35 * np.sin(angle))
    return np.stack([BODY_RADIUS + x, np.zeros(count), 0.05 + z], axis=1)


@pytest.fixture(scope="session", autouse=True)
def one_thread() -> None:
    """For these small networks, synchronising threads costs more than it saves."""
    import torch

    torch.set_num_threads(1)


@pytest.fixture
def make_handle() -> Callable[..., PointCloud]:
    """Returns a maker of handle clouds: `make_handle(shape, seed=, sides=, noise=)`.

    `sides` is the sampled range of the tube's circumference [rad]; 0 is +y.
    """

    def make(
        shape: str = "ear",
        *,
        seed: int = 0,
        count: int = 300,
        sides: tuple[float, float] = (0.0, 2 * np.pi),
        noise: float = 0.0,
    ) -> PointCloud:
        rng = np.random.default_rng(seed)
        line = handle_line(shape, 400)
        tangents = np.gradient(line, axis=0)
        tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
        k, angle = rng.integers(0, 400, count), rng.uniform(*sides, count)
        y = np.broadcast_to([0.0, 1.0, 0.0], (count, 3))
        normals = np.cos(angle)[:, None] * y + np.sin(angle)[:, None] * np.cross(tangents[k], y)
        points = line[k] + TUBE / 2 * normals + noise * rng.standard_normal((count, 3))
        return PointCloud(points, normals)

    return make


@pytest.fixture
def make_body() -> Callable[..., PointCloud]:
    """Returns a maker of clouds of an open cup's wall: `make_body(seed=)`, seen from above."""

    def make(*, seed: int = 0, count: int = 900) -> PointCloud:
        rng = np.random.default_rng(seed)
        angle = rng.uniform(-np.pi, np.pi, count)
        outward = np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
        inside = rng.uniform(size=count) < 0.4
        # From above, only the upper part of the inside is visible.
        z = np.where(inside, rng.uniform(0.4, 1.0, count), rng.uniform(0.0, 1.0, count))
        radius = np.where(inside, BODY_RADIUS - 0.003, BODY_RADIUS)
        points = radius[:, None] * outward + BODY_HEIGHT * z[:, None] * [0.0, 0.0, 1.0]
        return PointCloud(points, np.where(inside, -1.0, 1.0)[:, None] * outward)

    return make
