"""The simulated Panda: a URDF for Drake, generated once and kept in the user's cache.

It combines the Panda of `example-robot-data` (kinematics, inertias, primitive collision shapes of
the arm) with what Drake needs: actuators, acceleration limits, collision filters, small visual
meshes (.obj files with plain colours), and finger pads that can hold objects.
"""

import hashlib
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from poil_drake.robots import panda
from poil_drake.robots.panda import ACCELERATION_LIMITS, ARM_JOINTS, FINGER_JOINTS, GRIPPER_FRAME
from poil_drake.robots.robot_description import panda_description_directory, panda_urdf
from poil_drake.runtime.user_cache import cached_directory

if TYPE_CHECKING:
    import trimesh

PANDA_PACKAGE = "poil_drake_panda"
"""Drake package name of the generated model: `package://poil_drake_panda/panda.urdf`."""

GRIP_FORCE = 60.0
"""Largest force of each finger [N]. The real hand exerts up to 70 N; a mug held by its rim needs
most of that, because its weight tilts it."""

_PAD_SIZE = (0.018, 0.008, 0.0185)
"""Size of a finger pad along x, y and z of the finger's frame [m]; the real fingertip is 18 mm wide
and about 18.5 mm long."""

_PAD_PROPERTIES = {
    "mesh_resolution_hint": 0.01,
    "hydroelastic_modulus": 5e7,  # Stiffness of the rubber [Pa]; a mug tilts between softer pads.
    "hunt_crossley_dissipation": 10.0,  # [s/m]
    "mu_static": 1.2,  # Rubber on ceramics.
    "mu_dynamic": 1.2,
}
"""Contact properties of a finger pad, by their names in Drake."""

_MESHES = (*(f"link{i}" for i in range(8)), "hand", "finger")
"""The visual meshes, named as in `meshes/visual/<name>.dae`."""

_FACE_FRACTION = 0.1
"""Fraction of the triangles to keep. With all of them, rendering takes 2 to 3 times as long."""

_FEWEST_FACES = 60
"""Pieces with at most this many triangles keep all of them."""

_SHARPEST_SMOOTH_ANGLE = 0.6
"""An edge is not smoothed if the normals of its faces differ by more than this angle [rad]."""

_DRAKE_NAMESPACE = "http://drake.mit.edu"


def panda_package_directory() -> Path:
    """Returns the directory of `panda.urdf` and its meshes, after generating them if missing.

    The first call takes a few seconds; later calls, in any process, reuse the result.

    Raises:
        MissingDependencyError: if `example-robot-data` is not installed.
    """
    source = panda_description_directory()
    # The version covers everything that the result depends on, including this code.
    digest = hashlib.sha256()
    for path in (panda_urdf(), __file__, panda.__file__):
        digest.update(Path(path).read_bytes())

    def make(directory: Path) -> None:
        for name in _MESHES:
            pieces = _load_by_color(source / f"meshes/visual/{name}.dae")
            _write_obj(pieces, name=name, directory=directory)
        robot = ET.parse(panda_urdf()).getroot()
        _adapt(robot)
        ET.register_namespace("drake", _DRAKE_NAMESPACE)
        ET.indent(robot)
        ET.ElementTree(robot).write(
            directory / "panda.urdf", encoding="utf-8", xml_declaration=True
        )
        (directory / "package.xml").write_text(
            f'<?xml version="1.0"?>\n<package format="2"><name>{PANDA_PACKAGE}</name></package>\n'
        )

    return cached_directory(name="panda", version=digest.hexdigest()[:16], make=make)


def _adapt(robot: ET.Element) -> None:
    """Adapts the robot element of `panda_collision.urdf` to Drake, in place."""
    for mesh in robot.iter("mesh"):
        mesh.set("filename", f"{Path(mesh.get('filename', '')).stem}.obj")
    _replace_massless_links_by_frames(robot)
    links = {link.get("name", ""): link for link in robot.iter("link")}
    _replace_hand_collisions(links)
    # The lower half of the shoulder would rub against the table top.
    for collision in links["panda_link1"].findall("collision"):
        origin = collision.find("origin")
        if origin is not None and float(origin.get("xyz", "0 0 0").split()[2]) < -0.1:
            links["panda_link1"].remove(collision)
    for joint in robot.findall("joint"):
        _limit_joint(joint)
    for name in (*ARM_JOINTS, FINGER_JOINTS[0]):
        _add_actuator(robot, name)
    group = _add_drake_element(robot, "collision_filter_group", name="group_panda")
    for name in links:
        _add_drake_element(group, "member", link=name)
    _add_drake_element(group, "ignored_collision_filter_group", name="group_panda")


def _add_drake_element(parent: ET.Element, tag: str, **attributes: str) -> ET.Element:
    return ET.SubElement(parent, f"{{{_DRAKE_NAMESPACE}}}{tag}", attributes)


def _replace_massless_links_by_frames(robot: ET.Element) -> None:
    """Replaces link8 (the flange) and the gripper link with frames, because links need mass."""
    massless = {"panda_link8", GRIPPER_FRAME, "panda_joint8", "panda_hand_tcp_joint"}
    for element in [*robot.findall("link"), *robot.findall("joint")]:
        if element.get("name") in massless:
            robot.remove(element)
    hand_joint = next(j for j in robot.findall("joint") if j.get("name") == "panda_hand_joint")
    for parent in hand_joint.findall("parent"):
        parent.set("link", "panda_link7")
    for origin in hand_joint.findall("origin"):
        origin.set("xyz", "0 0 0.107")
    for name, link, xyz in (
        ("panda_link8", "panda_link7", "0 0 0.107"),
        (GRIPPER_FRAME, "panda_hand", "0 0 0.1034"),
    ):
        ET.SubElement(robot, "frame", name=name, link=link, xyz=xyz, rpy="0 0 0")


def _replace_hand_collisions(links: dict[str, ET.Element]) -> None:
    """Replaces the collision shapes: the hand gets a box, each finger a box and a compliant pad."""
    for name in ("panda_hand", "panda_leftfinger", "panda_rightfinger"):
        for collision in links[name].findall("collision"):
            links[name].remove(collision)
    _add_box(links["panda_hand"], "hand", center=(0.0, 0.0, 0.02), size=(0.063, 0.204, 0.09))
    _, pad_y, pad_z = _PAD_SIZE
    for name, side in (("panda_leftfinger", 1.0), ("panda_rightfinger", -1.0)):
        _add_box(links[name], "shank", center=(0, side * 0.0155, 0.017), size=(0.020, 0.019, 0.034))
        center = (0.0, side * pad_y / 2, 0.0539 - pad_z / 2)
        pad = _add_box(links[name], "pad", center=center, size=_PAD_SIZE)
        properties = _add_drake_element(pad, "proximity_properties")
        for key, value in _PAD_PROPERTIES.items():
            _add_drake_element(properties, key, value=str(value))
        _add_drake_element(properties, "compliant_hydroelastic")


def _add_box(
    link: ET.Element,
    name: str,
    *,
    center: tuple[float, float, float],
    size: tuple[float, float, float],
) -> ET.Element:
    collision = ET.SubElement(link, "collision", name=f"{link.get('name')}_{name}")
    ET.SubElement(collision, "origin", xyz=" ".join(f"{c:.6g}" for c in center))
    geometry = ET.SubElement(collision, "geometry")
    ET.SubElement(geometry, "box", size=" ".join(f"{s:.6g}" for s in size))
    return collision


def _limit_joint(joint: ET.Element) -> None:
    for unsupported in joint.findall("safety_controller"):
        joint.remove(unsupported)
    limit = joint.find("limit")
    if limit is None:
        return
    name = joint.get("name", "")
    if name in ARM_JOINTS:
        acceleration = ACCELERATION_LIMITS[ARM_JOINTS.index(name)]
        limit.set(f"{{{_DRAKE_NAMESPACE}}}acceleration", str(acceleration))
    else:
        # One motor drives both fingers, which share its force.
        limit.set("effort", str(2 * GRIP_FORCE))


def _add_actuator(robot: ET.Element, joint_name: str) -> None:
    transmission = ET.SubElement(robot, "transmission", name=f"{joint_name}_transmission")
    ET.SubElement(transmission, "type").text = "transmission_interface/SimpleTransmission"
    joint = ET.SubElement(transmission, "joint", name=joint_name)
    ET.SubElement(joint, "hardwareInterface").text = "hardware_interface/EffortJointInterface"
    ET.SubElement(transmission, "actuator", name=joint_name)


def _load_by_color(path: Path) -> "dict[tuple[int, ...], list[trimesh.Trimesh]]":
    """Returns the decimated pieces of a .dae file in the link's frame, keyed by RGB colour."""
    import trimesh

    pieces: dict[tuple[int, ...], list[trimesh.Trimesh]] = {}
    scene = trimesh.load(path, force="scene")
    for node in sorted(scene.graph.nodes_geometry):
        transform, geometry_name = scene.graph[node]
        mesh = scene.geometry[geometry_name].copy()
        color = tuple(int(c) for c in mesh.visual.material.main_color[:3])
        mesh.apply_transform(transform)
        pieces.setdefault(color, []).append(_decimate(mesh))
    return pieces


def _decimate(mesh: "trimesh.Trimesh") -> "trimesh.Trimesh":
    import open3d
    import trimesh

    mesh = trimesh.Trimesh(vertices=mesh.vertices, faces=mesh.faces, process=True)
    if len(mesh.faces) > _FEWEST_FACES:
        dense = open3d.geometry.TriangleMesh(
            open3d.utility.Vector3dVector(np.asarray(mesh.vertices)),
            open3d.utility.Vector3iVector(np.asarray(mesh.faces, dtype=np.int32)),
        )
        light = dense.simplify_quadric_decimation(
            max(_FEWEST_FACES, int(_FACE_FRACTION * len(mesh.faces)))
        )
        mesh = trimesh.Trimesh(
            vertices=np.asarray(light.vertices), faces=np.asarray(light.triangles), process=True
        )
    return trimesh.graph.smooth_shade(mesh, angle=_SHARPEST_SMOOTH_ANGLE)


def _write_obj(
    pieces: "dict[tuple[int, ...], list[trimesh.Trimesh]]", *, name: str, directory: Path
) -> None:
    """Writes pieces keyed by colour as `<name>.obj` and `<name>.mtl` into a directory.

    The format is .obj with vertex normals, because a single glTF file switches Drake's whole render
    engine to physically based rendering, which takes a quarter longer.
    """
    lines = [f"mtllib {name}.mtl"]
    materials = []
    offset = 1
    for color, meshes in sorted(pieces.items()):
        material = "color_" + "_".join(map(str, color))
        rgb = " ".join(f"{c / 255:.4f}" for c in color)
        materials += [f"newmtl {material}", f"Kd {rgb}", "Ks 0 0 0", "d 1", ""]
        lines.append(f"usemtl {material}")
        for mesh in meshes:
            lines += ["v {:.6f} {:.6f} {:.6f}".format(*v) for v in mesh.vertices]
            lines += ["vn {:.4f} {:.4f} {:.4f}".format(*n) for n in mesh.vertex_normals]
            lines += [
                "f " + " ".join(f"{i + offset}//{i + offset}" for i in face) for face in mesh.faces
            ]
            offset += len(mesh.vertices)
    (directory / f"{name}.obj").write_text("\n".join(lines) + "\n")
    (directory / f"{name}.mtl").write_text("\n".join(materials))
