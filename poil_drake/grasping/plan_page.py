"""An HTML page that shows a plan: the arm's rehearsed motion, the scene, and the grasps."""

import base64
import html
from pathlib import Path
from string import Template
from typing import Any

import meshcat
import meshcat.geometry as shapes
import numpy as np
import pinocchio
import umsgpack
from meshcat.animation import Animation
from meshcat.servers.zmqserver import VIEWER_ROOT
from pinocchio.visualize import MeshcatVisualizer

from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.grasping.planner import PlanningResult
from poil_drake.robots.robot_description import panda_description_directory
from poil_drake.runtime.output_files import whole_file


class _Window(list[str]):
    """Collects drawing commands in a list, whereas meshcat's own window sends them to a server."""

    def send(self, command: Any) -> None:
        self.append(base64.b64encode(umsgpack.packb(command.lower())).decode())


def write_plan_page(path: Path | str, result: PlanningResult, *, X_WB: np.ndarray) -> None:
    """Writes an HTML page that shows a plan, for a browser without a server or a network.

    The page opens with the arm at the grasp. Its time slider moves the arm along the approach, the
    rehearsed path and the retreat.

    Args:
        path: The HTML file to write.
        result: The plan and the data that it was chosen from.
        X_WB: (4, 4) pose of the robot's base in the world.
    """
    plan, chosen = result.plan, result.choice.candidate
    positions = plan.reference.positions
    commands = _Window()
    scene = meshcat.Visualizer(window=commands)
    _draw(scene["obstacles"], result.scene_points, (0.50, 0.50, 0.50))
    _draw(scene["object/cloud"], plan.object_points, (0.91, 0.64, 0.24))
    _draw(scene["object/functional_points"], plan.target_points, (0.82, 0.01, 0.11), size=0.009)
    _draw(scene["goal"], positions[-1], (0.11, 0.49, 0.24), size=0.009)
    _draw(scene["reference"], np.stack([positions[:-1], positions[1:]], axis=2), (0.48, 0.18, 0.75))
    for name, grasps, color in (
        ("chosen", [chosen], (0.00, 0.65, 0.32)),
        ("feasible", [g for g in result.feasible if g is not chosen], (0.18, 0.50, 0.93)),
        ("rejected", result.rejected, (0.90, 0.45, 0.45)),
    ):
        lines = [transform_points(g.X_WG, _gripper_lines(g.pregrasp_width)) for g in grasps]
        _draw(scene[f"grasps/{name}"], np.reshape(lines, (-1, 2, 3)), color)
    scene["robot"].set_transform(X_WB)
    _animate(scene, result)
    template = Path(__file__).with_suffix(".html").read_text(encoding="utf-8")
    page = Template(template).substitute(
        title=html.escape(f"Plan: {plan.object_label}, {plan.part_label}"),
        viewer=(Path(VIEWER_ROOT) / "main.min.js").read_text(encoding="utf-8"),
        commands=commands,
        time=plan.approach.duration + plan.descent.duration,
    )
    with whole_file(Path(path)) as file:
        file.write(page.encode())


def _draw(
    node: meshcat.Visualizer, points: np.ndarray, color: tuple[float, ...], size: float = 0.004
) -> None:
    """Draws points (P, 3), or segments between pairs of points (..., 2, 3) [m, world]."""
    position = np.float32(points.reshape(-1, 3))
    colors = np.broadcast_to(np.array(color, np.float32), position.shape)
    geometry = shapes.PointsGeometry(position.T, colors.T)
    if points.ndim == 2:
        node.set_object(geometry, shapes.PointsMaterial(size=size))
    else:
        node.set_object(shapes.LineSegments(geometry, shapes.LineBasicMaterial(vertexColors=True)))


def _gripper_lines(opening: float) -> np.ndarray:
    """Returns the segments (4, 2, 3) of a drawn gripper with an opening [m, gripper frame]."""
    y, z = 0.5 * opening, -0.04
    corners = np.array([[0, y, 0], [0, y, z], [0, -y, z], [0, -y, 0], [0, 0, z], [0, 0, 2 * z]])
    return corners[[[0, 1], [1, 2], [2, 3], [4, 5]]]


def _animate(scene: meshcat.Visualizer, result: PlanningResult) -> None:
    """Adds the Panda to the scene, and animates the arm and the object."""
    description = panda_description_directory()
    # The collision meshes take 130 kB, the visual ones 11 MB.
    model, meshes = pinocchio.buildModelsFromUrdf(
        str(description / "urdf/panda.urdf"),
        package_dirs=str(description.parents[2]),
        geometry_types=pinocchio.GeometryType.COLLISION,
    )
    robot = MeshcatVisualizer(model, visual_model=meshes)
    robot.initViewer(scene)
    robot.setBackgroundColor()
    robot.loadViewerModel("robot", visual_color=[0.9, 0.9, 0.92, 1.0])
    plan, path, finding = result.plan, result.choice.path, result.choice.feasibility
    carry_times, X_carry = path.times[path.samples], path.X_W[path.samples]
    retreat_times = np.linspace(0.0, 1.0, len(finding.q_retreat))  # Arbitrary: a plan has none.
    animation, start = Animation(default_framerate=1), 0.0  # One frame per second: keys are times.
    for times, q, opening, X_W in (
        (plan.approach.times, plan.approach.positions, plan.pregrasp_width, X_carry[:1]),
        (plan.descent.times, plan.descent.positions, plan.pregrasp_width, X_carry[:1]),
        (carry_times, finding.q_carry, plan.grasp_width, X_carry),
        (retreat_times, finding.q_retreat, plan.pregrasp_width, X_carry[-1:]),
    ):
        for k, time in enumerate(times):
            robot.viewer = animation.at_frame(scene, start + float(time))
            robot.display(np.r_[q[k], [0.5 * opening] * 2])
            robot.viewer["object"].set_transform(X_W[min(k, len(X_W) - 1)])
        start += float(times[-1])
    scene.set_animation(animation, play=False)
