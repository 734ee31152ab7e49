"""The Panda that the station simulates: a URDF for Drake, made once into the user's cache.

It joins what `example-robot-data` holds (kinematics, inertias, primitive collision shapes of the
arm) with what Drake needs: actuators, acceleration limits, collision filters, light visual meshes,
and finger pads that can hold things.
"""

import hashlib
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

from poil_drake.models import panda_visuals
from poil_drake.robots.robot_description import panda_description_directory
from poil_drake.runtime.user_cache import cached_directory

PANDA_PACKAGE = "poil_drake_panda"
"""Drake package name of the generated model: `package://poil_drake_panda/panda.urdf`."""

ARM_JOINTS = tuple(f"panda_joint{i}" for i in range(1, 8))
"""The arm's joints, in the order of every 7-vector."""

BASE_LINK = "panda_link0"
"""The link that is welded to the world."""

FINGER_JOINTS = ("panda_finger_joint1", "panda_finger_joint2")
"""The fingers' joints; the second one mimics the first."""

GRIPPER_FRAME = "panda_hand_tcp"
"""The gripper frame G: between the finger tips, +z approach, fingers close along y."""

_DRAKE_NAMESPACE = "http://drake.mit.edu"


@dataclass(frozen=True, kw_only=True)
class PandaModelConfig:
    """What may be chosen about the generated Panda.

    Attributes:
        acceleration_limits: The arm's joint acceleration limits [rad/s^2], from the datasheet.
        grip_force: Largest force of each finger [N]. The real hand holds with up to 70 N; a mug
            held by its rim needs a good part of it, as its weight tilts it.
        pad_size: Finger pad along the finger frame's x, y, z [m]; the real tip is 18 mm wide and
            about 18.5 mm long.
        pad_hydroelastic_modulus: Stiffness of the rubber [Pa]; softer pads let a mug tilt.
        pad_dissipation: Hunt-Crossley dissipation of the pad [s/m].
        pad_friction: Friction coefficient of rubber on ceramics, static and dynamic.
    """

    acceleration_limits: tuple[float, ...] = (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0)
    grip_force: float = 60.0
    pad_size: tuple[float, float, float] = (0.018, 0.008, 0.0185)
    pad_hydroelastic_modulus: float = 5e7
    pad_dissipation: float = 10.0
    pad_friction: float = 1.2


def panda_package_directory(config: PandaModelConfig | None = None) -> Path:
    """Returns the directory of the generated `panda.urdf` and its meshes, made when missing.

    The first call takes a few seconds; later ones, in any process, only look.

    Raises:
        MissingDependencyError: when `example-robot-data` is not installed.
    """
    config = config or PandaModelConfig()
    source = panda_description_directory()
    # Whatever the result depends on, this code included, gives it a directory of its own.
    inputs = (source / "urdf/panda_collision.urdf", Path(__file__), Path(panda_visuals.__file__))
    digest = hashlib.sha256(repr(config).encode())
    for path in inputs:
        digest.update(path.read_bytes())

    def make(directory: Path) -> None:
        panda_visuals.convert_visuals(source=source / "meshes/visual", target=directory)
        robot = ET.parse(source / "urdf/panda_collision.urdf").getroot()
        _adapt(robot, config)
        ET.register_namespace("drake", _DRAKE_NAMESPACE)
        ET.indent(robot)
        ET.ElementTree(robot).write(
            directory / "panda.urdf", encoding="utf-8", xml_declaration=True
        )
        (directory / "package.xml").write_text(
            f'<?xml version="1.0"?>\n<package format="2"><name>{PANDA_PACKAGE}</name></package>\n'
        )

    return cached_directory(name="panda", version=digest.hexdigest()[:16], make=make)


def _adapt(robot: ET.Element, config: PandaModelConfig) -> None:
    """Turns the robot element of `panda_collision.urdf` into the one that Drake gets."""
    for mesh in robot.iter("mesh"):
        mesh.set("filename", f"{Path(mesh.get('filename', '')).stem}.obj")
    _replace_massless_links_by_frames(robot)
    links = {link.get("name", ""): link for link in robot.iter("link")}
    _replace_hand_collisions(links, config)
    # The lower half of the shoulder stands in the table top, where it would rub.
    for collision in links["panda_link1"].findall("collision"):
        origin = collision.find("origin")
        if origin is not None and float(origin.get("xyz", "0 0 0").split()[2]) < -0.1:
            links["panda_link1"].remove(collision)
    for joint in robot.findall("joint"):
        _limit_joint(joint, config)
    for name in (*ARM_JOINTS, FINGER_JOINTS[0]):
        _add_actuator(robot, name)
    group = ET.SubElement(
        robot, f"{{{_DRAKE_NAMESPACE}}}collision_filter_group", name="group_panda"
    )
    for name in links:
        ET.SubElement(group, f"{{{_DRAKE_NAMESPACE}}}member", link=name)
    ET.SubElement(
        group, f"{{{_DRAKE_NAMESPACE}}}ignored_collision_filter_group", name="group_panda"
    )


def _replace_massless_links_by_frames(robot: ET.Element) -> None:
    """Makes frames of link8 (the flange) and of the gripper frame: bodies need mass."""
    for element in [*robot.findall("link"), *robot.findall("joint")]:
        if element.get("name") in {
            "panda_link8",
            GRIPPER_FRAME,
            "panda_joint8",
            "panda_hand_tcp_joint",
        }:
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


def _replace_hand_collisions(links: dict[str, ET.Element], config: PandaModelConfig) -> None:
    """Gives the hand a box, and each finger a box and a compliant pad."""
    for name in ("panda_hand", "panda_leftfinger", "panda_rightfinger"):
        for collision in links[name].findall("collision"):
            links[name].remove(collision)
    _add_box(links["panda_hand"], "hand", center=(0.0, 0.0, 0.02), size=(0.063, 0.204, 0.09))
    pad_x, pad_y, pad_z = config.pad_size
    for name, side in (("panda_leftfinger", 1.0), ("panda_rightfinger", -1.0)):
        _add_box(links[name], "shank", center=(0, side * 0.0155, 0.017), size=(0.020, 0.019, 0.034))
        pad = _add_box(
            links[name],
            "pad",
            center=(0.0, side * pad_y / 2, 0.0539 - pad_z / 2),
            size=(pad_x, pad_y, pad_z),
        )
        properties = ET.SubElement(pad, f"{{{_DRAKE_NAMESPACE}}}proximity_properties")
        for key, value in (
            ("mesh_resolution_hint", 0.01),
            ("hydroelastic_modulus", config.pad_hydroelastic_modulus),
            ("hunt_crossley_dissipation", config.pad_dissipation),
            ("mu_static", config.pad_friction),
            ("mu_dynamic", config.pad_friction),
        ):
            ET.SubElement(properties, f"{{{_DRAKE_NAMESPACE}}}{key}", value=str(value))
        ET.SubElement(properties, f"{{{_DRAKE_NAMESPACE}}}compliant_hydroelastic")


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


def _limit_joint(joint: ET.Element, config: PandaModelConfig) -> None:
    for unsupported in joint.findall("safety_controller"):
        joint.remove(unsupported)
    limit = joint.find("limit")
    if limit is None:
        return
    name = joint.get("name", "")
    if name in ARM_JOINTS:
        acceleration = config.acceleration_limits[ARM_JOINTS.index(name)]
        limit.set(f"{{{_DRAKE_NAMESPACE}}}acceleration", str(acceleration))
    else:
        # The one motor drives both fingers, so its force divides into two.
        limit.set("effort", str(2 * config.grip_force))


def _add_actuator(robot: ET.Element, joint_name: str) -> None:
    transmission = ET.SubElement(robot, "transmission", name=f"{joint_name}_transmission")
    ET.SubElement(transmission, "type").text = "transmission_interface/SimpleTransmission"
    joint = ET.SubElement(transmission, "joint", name=joint_name)
    ET.SubElement(joint, "hardwareInterface").text = "hardware_interface/EffortJointInterface"
    ET.SubElement(transmission, "actuator", name=joint_name)
