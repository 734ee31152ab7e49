"""Renders images of one scene repeatedly, but only where the scene has changed."""

from collections.abc import Sequence

import numpy as np
from pydrake.geometry import (
    ColorRenderCamera,
    DepthRenderCamera,
    GeometryId,
    QueryObject,
    RenderCameraCore,
    Role,
    SceneGraph,
    SceneGraphInspector,
)
from pydrake.systems.framework import Context, Diagram
from pydrake.systems.sensors import CameraInfo, RgbdSensor

from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.perception.images import RgbdImage
from poil_drake.systems.cameras.camera_ports import copied_image

_AT_REST = 1e-6  # Largest change of an entry of X_WG of a geometry that counts as being at rest.
_MARGIN = 4  # [px] Anti-aliasing blends pixels on both sides of an edge.
_BORDER = 12  # [px] Anti-aliasing follows an edge this far; rendered, but not used.
_CUBE = np.array(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0])).reshape(3, 8).T


class IncrementalRenderer:
    """Captures colour and depth images with the fixed cameras of `AddCameras`.

    Each capture renders only one rectangle of each image, and keeps the other pixels of the last
    capture. The rectangle encloses all geometries that have moved since, at their old and their new
    poses. The images equal those of the cameras' ports, except for about one pixel in 10,000 at
    silhouettes. Each capture renders all geometries if the renderer casts shadows or is not Drake's
    own, or if the scene holds deformable bodies.
    """

    def __init__(self, diagram: Diagram, scene_graph: SceneGraph, camera_names: Sequence[str]):
        """Looks up the cameras.

        Args:
            diagram: Exports `query_object` and holds the cameras.
            scene_graph: The diagram's scene graph.
            camera_names: Names of the cameras to render.
        """
        self._query = diagram.GetOutputPort("query_object")
        self._names = tuple(camera_names)
        self._noises = [diagram.GetSubsystemByName(f"depth_noise_{name}") for name in camera_names]
        sensors = [diagram.GetSubsystemByName(f"rgbd_sensor_{name}") for name in camera_names]
        self._colors = [_Picture(s, s.default_color_render_camera()) for s in sensors]
        self._depths = [_Picture(s, s.default_depth_render_camera()) for s in sensors]
        inspector = scene_graph.model_inspector()
        deformable = inspector.GetAllDeformableGeometryIds()
        rendered = inspector.GetAllGeometryIds(Role.kPerception)
        self._geometries = [geometry for geometry in rendered if geometry not in deformable]
        boxes = [_box(inspector, geometry) for geometry in self._geometries]
        self._boxes_G = np.array(boxes).reshape(-1, 8, 3)
        renderers = {s.default_color_render_camera().core().renderer_name() for s in sensors}
        self._local = not deformable and all(
            _pixels_are_local(scene_graph.GetRendererParameterYaml(name)) for name in renderers
        )
        if not self._local:
            self._boxes_G[:] = np.nan  # Encloses everything.
        self._poses = np.full((len(self._geometries), 4, 4), np.nan)

    def capture(self, context: Context) -> dict[str, RgbdImage]:
        """Returns each camera's current image by the camera's name.

        Args:
            context: The diagram's own context.
        """
        query = self._query.Eval(context)
        found = [query.GetPoseInWorld(geometry).GetAsMatrix4() for geometry in self._geometries]
        poses = np.array(found).reshape(-1, 4, 4)
        still = np.abs(poses - self._poses).max(axis=(1, 2)) <= _AT_REST
        moved = ~(still & self._local)
        boxes_W = [
            transform_points(X_WG[moved], self._boxes_G[moved]) for X_WG in (self._poses, poses)
        ]
        self._poses[moved] = poses[moved]
        if moved.any():
            for picture in (*self._colors, *self._depths):
                picture.update(query, np.concatenate(boxes_W).reshape(-1, 3))
        time = context.get_time()
        views = zip(self._names, self._colors, self._depths, self._noises, strict=True)
        return {
            name: copied_image(
                color.pixels, noise.noisy(depth.pixels[:, :, 0], time)[:, :, None], None, stamp=time
            )
            for name, color, depth, noise in views
        }


class _Picture:
    """The newest colour or depth image of a camera, without noise.

    Attributes:
        pixels: (H, W, channels) the image.
    """

    def __init__(self, sensor: RgbdSensor, camera: ColorRenderCamera | DepthRenderCamera):
        core = camera.core()
        info = core.intrinsics()
        self._camera, self._core, self._K = camera, core, info.intrinsic_matrix()
        self._size = np.array([info.width(), info.height()])
        self._where = {"parent_frame": sensor.default_parent_frame_id()}
        self._where["X_PC"] = sensor.default_X_PB()
        X_WC = sensor.default_X_PB() @ core.sensor_pose_in_camera_body()
        self._X_CW = X_WC.inverse().GetAsMatrix4()
        channels, kind = (1, np.float32) if isinstance(camera, DepthRenderCamera) else (4, np.uint8)
        self.pixels = np.zeros((info.height(), info.width(), channels), kind)

    def update(self, query: QueryObject, points_W: np.ndarray) -> None:
        """Renders the rectangle that encloses points (N, 3) in the world [m].

        Renders the whole image if a point is NaN or is not in front of the camera.
        """
        p = transform_points(self._X_CW, points_W) @ self._K.T
        low, high = np.zeros(2, int), self._size
        if (p[:, 2] > self._core.clipping().near()).all():
            uv = p[:, :2] / p[:, 2:]
            low = np.maximum(np.floor(uv.min(axis=0)) - _MARGIN, low).astype(int)
            high = np.minimum(np.ceil(uv.max(axis=0)) + _MARGIN, high).astype(int)
        if (low >= high).any():
            return
        # Drake requires that the principal point lies in the image.
        center = self._K[:2, 2]
        start = np.clip(low - _BORDER, 0, np.ceil(center).astype(int) - 1)
        stop = np.clip(high + _BORDER, np.floor(center).astype(int) + 1, self._size)
        (x, y), (w, h), (a, b) = low - start, high - low, low
        self.pixels[b : b + h, a : a + w] = self._render(query, start, stop)[y : y + h, x : x + w]

    def _render(self, query: QueryObject, start: np.ndarray, stop: np.ndarray) -> np.ndarray:
        """Renders the pixels (x, y) from `start` (2,) up to, but not including, `stop` (2,)."""
        (width, height), (x, y), K = (stop - start).tolist(), start, self._K
        info = CameraInfo(width, height, K[0, 0], K[1, 1], K[0, 2] - x, K[1, 2] - y)
        core = RenderCameraCore(
            self._core.renderer_name(),
            info,
            self._core.clipping(),
            self._core.sensor_pose_in_camera_body(),
        )
        if isinstance(self._camera, DepthRenderCamera):
            depth_camera = DepthRenderCamera(core, self._camera.depth_range())
            return query.RenderDepthImage(camera=depth_camera, **self._where).data
        return query.RenderColorImage(camera=ColorRenderCamera(core), **self._where).data


def _box(inspector: SceneGraphInspector, geometry: GeometryId) -> np.ndarray:
    """Returns the corners (8, 3) of a box around a geometry in its frame; NaN if it has no box."""
    box = inspector.GetObbInGeometryFrame(geometry)
    if box is None:
        return np.full((8, 3), np.nan)
    return transform_points(box.pose().GetAsMatrix4(), _CUBE * box.half_width())


def _pixels_are_local(renderer: str) -> bool:
    """Returns whether each pixel shows only what is behind it, given the renderer's parameters."""
    own = renderer.startswith(("RenderEngineVtkParams:", "RenderEngineGlParams:"))
    return own and "cast_shadows: true" not in renderer
