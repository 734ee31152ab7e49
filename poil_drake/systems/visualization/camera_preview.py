"""Shows what real cameras see in Meshcat: one coloured cloud of all cameras."""

from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.geometry import Meshcat, Rgba
from pydrake.perception import BaseField, Fields, PointCloud

from poil_drake.geometry.depth_image import unproject
from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.systems.visualization.meshcat_overlay import MeshcatOverlay

_PATH = "cameras"
"""The Meshcat path below which everything is drawn."""

_POINTS = 30_000  # of each camera; the page receives 24 bytes for each point.
_POINT_SIZE = 0.007  # [m]
_VIEW_DEPTH = 0.12  # [m] Height of the pyramid that marks a camera.
_COLORS = (
    Rgba(1.0, 0.25, 0.0),
    Rgba(0.0, 0.4, 1.0),
    Rgba(0.0, 0.65, 0.3),
    Rgba(0.5, 0.0, 0.9),
)
"""The cameras' colours, in turn."""


class CameraPreview:
    """Draws the cloud of each camera [m, world], a pyramid at each camera, and a line of text.

    The clouds of calibrated cameras lie on each other. Call the methods on the thread that made
    Meshcat.
    """

    def __init__(self, meshcat: Meshcat, cameras: Sequence[CameraModel], *, texts: Sequence[str]):
        """Draws the pyramids and the legend.

        Args:
            meshcat: Where to draw. Everything below the path `cameras` is deleted first.
            cameras: The cameras' models.
            texts: All texts that can be shown.
        """
        self._meshcat, self._cameras, self._texts = meshcat, tuple(cameras), list(texts)
        self._drawn: dict[str, RgbdImage] = {}
        meshcat.Delete(_PATH)
        colors = {c.name: _COLORS[k % len(_COLORS)] for k, c in enumerate(self._cameras)}
        self._overlay = MeshcatOverlay(meshcat, phase_names=self._texts, legend=colors)
        for camera in self._cameras:
            start, end = _pyramid(camera)
            meshcat.SetLineSegments(
                f"{_PATH}/{camera.name}/pyramid", start, end, 2.0, colors[camera.name]
            )

    def show_text(self, text: str) -> None:
        """Shows one of the texts."""
        self._overlay.show_phase(self._texts.index(text))

    def show_images(self, images: Mapping[str, RgbdImage | None]) -> None:
        """Draws the newest image of each camera, by name; None leaves its cloud as it is."""
        for camera in self._cameras:
            image = images[camera.name]
            if image is None or image is self._drawn.get(camera.name):
                continue
            self._drawn[camera.name] = image
            points, colors = sparse_points(camera, image)
            cloud = PointCloud(len(points), Fields(BaseField.kXYZs | BaseField.kRGBs))
            cloud.mutable_xyzs()[:] = points.T
            cloud.mutable_rgbs()[:] = colors.T
            self._meshcat.SetObject(f"{_PATH}/{camera.name}/cloud", cloud, _POINT_SIZE)


def sparse_points(camera: CameraModel, image: RgbdImage) -> tuple[np.ndarray, np.ndarray]:
    """Returns at most about `_POINTS` points (P, 3) [m, world] of an image, and colours (P, 3)."""
    step = max(1, round(np.sqrt(image.depth.size / _POINTS)))
    mask = np.zeros(image.depth.shape, dtype=bool)
    mask[::step, ::step] = image.depth[::step, ::step] > 0.0
    points, pixels = unproject(image.depth, camera.K, mask)
    return transform_points(camera.X_WC, points), image.rgb[pixels[:, 1], pixels[:, 0]]


def _pyramid(camera: CameraModel) -> tuple[np.ndarray, np.ndarray]:
    """Returns the starts and ends, each (3, 8) [m, world], of the edges of a camera's view."""
    u, v = camera.width - 0.5, camera.height - 0.5
    corners = np.array([[-0.5, -0.5, 1.0], [u, -0.5, 1.0], [u, v, 1.0], [-0.5, v, 1.0]])
    base = _VIEW_DEPTH * np.linalg.solve(camera.K, corners.T).T
    start = np.vstack([np.zeros((4, 3)), base])
    end = np.vstack([base, np.roll(base, -1, axis=0)])
    return transform_points(camera.X_WC, start).T, transform_points(camera.X_WC, end).T
