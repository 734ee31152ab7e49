"""Draws the skill's points, reference, twist, phase and error in Meshcat."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import Meshcat, Rgba
from pydrake.systems.framework import Context, InputPort, LeafSystem

from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.systems.visualization.meshcat_markers import ArrowMarker, DrawTubes, SphereMarkers
from poil_drake.systems.visualization.meshcat_overlay import MeshcatOverlay

_PATH = "poil"
"""The Meshcat path below which everything is drawn."""


@dataclass(frozen=True, kw_only=True)
class PointSetVisualizerConfig:
    """How the skill is drawn. Colours are (r, g, b, a) in [0, 1]."""

    period: float = 1 / 32  # [s] between moves; the frame rate of recordings should match.
    text_period: float = 1 / 8  # [s] between changes of text; faster changes are unreadable.
    point_radius: float = 0.005  # [m]
    target_radius: float = 0.004  # [m]
    tracked_radius: float = 0.003  # [m]
    reference_radius: float = 0.0016  # [m] Meshcat's own lines are one pixel wide.
    arrow_radius: float = 0.003  # [m]
    seconds_per_linear_speed: float = 0.8  # [m of arrow per m/s]
    arrow_per_angular_speed: float = 0.15  # [m of arrow per rad/s]
    sure_confidence: float = 0.25  # Points with less are drawn smaller, in `unsure_color`.
    point_color: tuple[float, float, float, float] = (1.0, 0.25, 0.0, 1.0)
    unsure_color: tuple[float, float, float, float] = (0.45, 0.45, 0.45, 1.0)
    tracked_color: tuple[float, float, float, float] = (1.0, 0.8, 0.0, 1.0)
    target_color: tuple[float, float, float, float] = (0.0, 0.75, 0.35, 1.0)
    reference_start_color: tuple[float, float, float, float] = (0.75, 0.65, 1.0, 1.0)
    reference_color: tuple[float, float, float, float] = (0.4, 0.0, 0.9, 1.0)
    goal_color: tuple[float, float, float, float] = (0.4, 0.0, 0.9, 0.35)
    linear_color: tuple[float, float, float, float] = (0.0, 0.4, 1.0, 1.0)
    angular_color: tuple[float, float, float, float] = (1.0, 0.0, 0.6, 1.0)


class PointSetVisualizer(LeafSystem):
    """Draws in Meshcat what the controller sees and does, live and for a recording.

    .. pydrake_system::

        name: PointSetVisualizer
        input_ports:
        - points
        - confidence
        - target_points
        - spatial_velocity
        - gripper_pose
        - phase
        - mean_error
        - tracked_points

    With N the reference's number of points:

    - `points` is (3N,), row-major [m, world]: the controller's input points.
    - `confidence` is (N,) in [0, 1]; points with low confidence are drawn small and grey.
    - `target_points` is (3N,), row-major [m, world]: the points' current targets on the reference.
    - `spatial_velocity` is (6,), (ω [rad/s], v [m/s]) in the world frame, drawn as two arrows that
      start at the gripper.
    - `gripper_pose` is (16,), X_WG row-major.
    - `phase` is (1,), an index into the names of the phases.
    - `mean_error` is (1,), the mean distance between points and target points [m].
    - `tracked_points` is an abstract `TrackedPoints`: the tracker's latest output.

    Every port is optional; the value of an unconnected port is not drawn, and neither is a value
    that is not finite. Before the first input, only the reference is visible. The constructor draws
    the reference and hidden marks; periodic publish events show and move the marks.
    """

    def __init__(
        self,
        *,
        meshcat: Meshcat,
        reference: PointTrajectory,
        phase_names: Sequence[str] = (),
        config: PointSetVisualizerConfig | None = None,
    ):
        """Draws the reference and prepares the marks.

        Args:
            meshcat: Where to draw. Everything below the path `poil` is deleted first.
            reference: The reference that the controller follows.
            phase_names: The phases' names, by index.
            config: Sizes, colours and rates.
        """
        super().__init__()
        self._config = config or PointSetVisualizerConfig()
        self._num_points = reference.positions.shape[1]
        self._declare_ports()
        self._draw(meshcat, reference, phase_names)
        self.DeclarePeriodicPublishEvent(self._config.period, 0.0, self._publish_motion)
        self.DeclarePeriodicPublishEvent(self._config.text_period, 0.0, self._publish_text)
        self.DeclareForcedPublishEvent(self._publish_motion)
        self.DeclareForcedPublishEvent(self._publish_text)

    def _declare_ports(self) -> None:
        size = 3 * self._num_points
        self._points = self.DeclareVectorInputPort("points", size)
        self._confidence = self.DeclareVectorInputPort("confidence", self._num_points)
        self._target_points = self.DeclareVectorInputPort("target_points", size)
        self._spatial_velocity = self.DeclareVectorInputPort("spatial_velocity", 6)
        self._gripper_pose = self.DeclareVectorInputPort("gripper_pose", 16)
        self._phase = self.DeclareVectorInputPort("phase", 1)
        self._mean_error = self.DeclareVectorInputPort("mean_error", 1)
        self._tracked_points = self.DeclareAbstractInputPort(
            "tracked_points", Value(TrackedPoints.lost(self._num_points, 0.0))
        )

    def _draw(
        self, meshcat: Meshcat, reference: PointTrajectory, phase_names: Sequence[str]
    ) -> None:
        config = self._config
        meshcat.Delete(_PATH)
        DrawTubes(
            meshcat,
            f"{_PATH}/reference/tubes",
            np.swapaxes(reference.positions, 0, 1),
            radius=config.reference_radius,
            start_color=Rgba(*config.reference_start_color),
            end_color=Rgba(*config.reference_color),
        )

        def spheres(name: str, radius: float, *colors: tuple) -> SphereMarkers:
            return SphereMarkers(
                meshcat,
                f"{_PATH}/{name}",
                count=self._num_points,
                radius=radius,
                colors=[Rgba(*color) for color in colors],
            )

        goal = spheres("reference/goal", config.point_radius, config.goal_color)
        goal.move(reference.positions[-1])
        self._point_marks = spheres(
            "points", config.point_radius, config.point_color, config.unsure_color
        )
        self._target_marks = spheres("target_points", config.target_radius, config.target_color)
        self._tracked_marks = spheres("tracked_points", config.tracked_radius, config.tracked_color)
        self._linear_arrow, self._angular_arrow = (
            ArrowMarker(meshcat, f"{_PATH}/{name}", radius=config.arrow_radius, color=Rgba(*color))
            for name, color in (
                ("linear_velocity", config.linear_color),
                ("angular_velocity", config.angular_color),
            )
        )
        self._overlay = MeshcatOverlay(
            meshcat,
            phase_names=phase_names,
            legend={
                "points": Rgba(*config.point_color),
                "tracker": Rgba(*config.tracked_color),
                "target now": Rgba(*config.target_color),
                "reference": Rgba(*config.reference_color),
                "v": Rgba(*config.linear_color),
                "ω": Rgba(*config.angular_color),
            },
        )

    def _publish_motion(self, context: Context) -> None:
        time = context.get_time()
        for marks, positions in self._marks_and_positions(context):
            marks.move(positions, time)
        V_WG = _value_or_nan(self._spatial_velocity, context)
        p_WG = _value_or_nan(self._gripper_pose, context).reshape(4, 4)[:3, 3]
        self._angular_arrow.show(p_WG, V_WG[:3] * self._config.arrow_per_angular_speed, time)
        self._linear_arrow.show(p_WG, V_WG[3:] * self._config.seconds_per_linear_speed, time)

    def _publish_text(self, context: Context) -> None:
        time = context.get_time()
        for marks, positions in self._marks_and_positions(context):
            looks = np.zeros(self._num_points, dtype=int)
            if marks is self._point_marks and self._confidence.HasValue(context):
                looks[~(self._confidence.Eval(context) >= self._config.sure_confidence)] = 1
            looks[~np.isfinite(positions).all(axis=1)] = -1
            marks.choose_looks(looks, time)
        phase = _value_or_nan(self._phase, context)[0]
        self._overlay.show_phase(round(phase) if np.isfinite(phase) else None, time)
        self._overlay.show_error(_value_or_nan(self._mean_error, context)[0], time)

    def _marks_and_positions(self, context: Context) -> list[tuple[SphereMarkers, np.ndarray]]:
        """Returns each set of marks with its positions (N, 3) [m, world]; NaN where unknown."""
        tracked = np.full((self._num_points, 3), np.nan)
        if self._tracked_points.HasValue(context):
            tracked = self._tracked_points.Eval(context).positions
        return [
            (self._point_marks, _value_or_nan(self._points, context).reshape(-1, 3)),
            (self._target_marks, _value_or_nan(self._target_points, context).reshape(-1, 3)),
            (self._tracked_marks, tracked),
        ]


def _value_or_nan(port: InputPort, context: Context) -> np.ndarray:
    return port.Eval(context) if port.HasValue(context) else np.full(port.size(), np.nan)
