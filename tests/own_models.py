"""A user's own mugs and racks, as files in the formats and structures that people use.

Every mug is the same: a cylinder that stands on the origin, and a handle of three bars towards +x.
"""

from collections.abc import Sequence
from pathlib import Path

Bar = tuple[str, tuple[float, float, float], tuple[float, float, float]]

BOWL_RADIUS, BOWL_HEIGHT = 0.035, 0.09
HANDLE: tuple[Bar, ...] = (
    ("upper", (0.0575, 0.0, 0.08), (0.045, 0.012, 0.008)),
    ("outer", (0.076, 0.0, 0.045), (0.008, 0.012, 0.078)),
    ("lower", (0.0575, 0.0, 0.01), (0.045, 0.012, 0.008)),
)
"""Name, centre and size [m] of each bar, in the mug's frame."""


PACKAGE_MUG = "package://poil_drake/mugs/mug_a/mug_a.sdf"


def urdf_mug(links: str = "body handle", *, root: str = "", inertial: bool = True) -> str:
    """Returns a mug as URDF, with its links in the given order; `root` is an empty base link."""
    mass = '<inertial><origin xyz="0 0 0.045"/><mass value="0.15"/><inertia ixx="1.5e-4" '
    mass += 'iyy="1.5e-4" izz="1.2e-4" ixy="0" ixz="0" iyz="0"/></inertial>'
    parts = {"body": _urdf_shape("bowl", (0, 0, BOWL_HEIGHT / 2), _urdf_cylinder())}
    parts["handle"] = "".join(
        _urdf_shape(name, center, f'<box size="{_text(size)}"/>') for name, center, size in HANDLE
    )
    found = {n: f'<link name="{n}">{mass if inertial else ""}{parts[n]}</link>' for n in parts}
    found[root] = f'<link name="{root}"/>'
    joints = '<joint name="glue" type="fixed"><parent link="body"/><child link="handle"/></joint>'
    if root:
        joints += f'<joint name="root" type="fixed"><parent link="{root}"/>'
        joints += '<child link="body"/></joint>'
    return f'<robot name="cup">{"".join(found[n] for n in links.split())}{joints}</robot>'


def sdf_mug(links: str = "body handle", *, grip: str = "", inertial: bool = True) -> str:
    """Returns a mug as an SDFormat model "cup", with its links in the given order.

    `grip` replaces the handle's bars by other visuals and collisions.
    """
    mass = "<inertial><pose>0 0 0.045 0 0 0</pose><mass>0.15</mass><inertia><ixx>1.5e-4</ixx>"
    mass += "<iyy>1.5e-4</iyy><izz>1.2e-4</izz></inertia></inertial>"
    bowl = f"<cylinder><radius>{BOWL_RADIUS}</radius><length>{BOWL_HEIGHT}</length></cylinder>"
    parts = {"body": sdf_shape("bowl", (0, 0, BOWL_HEIGHT / 2), bowl)}
    parts["handle"] = grip or "".join(
        sdf_shape(name, center, f"<box><size>{_text(size)}</size></box>")
        for name, center, size in HANDLE
    )
    found = [f'<link name="{n}">{mass if inertial else ""}{parts[n]}</link>' for n in links.split()]
    glue = '<joint name="glue" type="fixed"><parent>body</parent><child>handle</child></joint>'
    return f'<model name="cup">{"".join(found)}{glue}</model>'


def sdf_file(model: str) -> str:
    """Returns the text of an SDFormat file that holds a model."""
    return f'<?xml version="1.0"?><sdf version="1.9">{model}</sdf>'


def sdf_shape(
    name: str,
    center: Sequence[float],
    shape: str,
    *,
    kinds: Sequence[str] = ("visual", "collision"),
) -> str:
    """Returns a shape as visual and collision."""
    inner = f"<pose>{_text(center)} 0 0 0</pose><geometry>{shape}</geometry>"
    return "".join(f'<{kind} name="{name}">{inner}</{kind}>' for kind in kinds)


def mjcf_mug(joint: str = "<freejoint/>", *, mass: str = 'mass="0.03"') -> str:
    """Returns a mug as the MJCF body "body", with the body "handle" below it."""
    geoms = "".join(
        f'<geom name="{name}" type="box" pos="{_text(center)}" {mass} '
        f'size="{_text([0.5 * s for s in size])}"/>'
        for name, center, size in HANDLE
    )
    return (
        f'<body name="body" pos="0.47 -0.12 0">{joint}<geom name="bowl" type="cylinder" {mass} '
        f'pos="0 0 {BOWL_HEIGHT / 2}" size="{BOWL_RADIUS} {BOWL_HEIGHT / 2}"/>'
        f'<body name="handle">{geoms}</body></body>'
    )


def mjcf_rack(joint: str = "") -> str:
    """Returns a rack as the MJCF body "stand", with a rod that rises towards -y."""
    return (
        f'<body name="stand" pos="0.55 0.30 0">{joint}'
        '<geom name="base" type="box" size="0.08 0.08 0.0075" pos="0 0 0.0075"/>'
        '<geom name="post" type="cylinder" size="0.011 0.14" pos="0 0 0.14"/>'
        '<geom name="rod_bar" type="capsule" size="0.0055" fromto="0 0 0.26 0 -0.135 0.296"/>'
        "</body>"
    )


def mjcf_file(*bodies: str) -> str:
    """Returns the text of an MJCF file that holds bodies."""
    return f'<mujoco model="own"><worldbody>{"".join(bodies)}</worldbody></mujoco>'


def add_mug(
    file: str | Path = PACKAGE_MUG,
    *,
    name: str = "mug",
    pose_of: str = "body",
    pose: str = "translation: [0.47, -0.12, 0.0], rotation: !Rpy {deg: [0, 0, 30]}",
) -> str:
    """Returns a directive that adds a mug, with a default pose for a link unless this is empty."""
    poses = f"{{'{pose_of}': {{{pose}}}}}" if pose_of else "{}"
    return f"{{add_model: {{name: {name}, file: '{file}', default_free_body_pose: {poses}}}}}"


def own_scenario(
    *,
    mug: str | Path = PACKAGE_MUG,
    pose_of: str = "body",
    rack: str | Path = "package://poil_drake/fixtures/rack.sdf",
    weld_rack: str = "rack::stand",
    more: str = "",
    poil: str = "",
) -> str:
    """Returns the text of a scenario, for `ChooseScenario(data=...)`, with the user's models.

    `more` holds further directives. An empty mug or rack is left out, as is an empty weld.
    """
    place = "{translation: [0.55, 0.30, 0.0]}"
    directives = [
        "{add_model: {name: table, file: 'package://poil_drake/fixtures/table.sdf'}}",
        "{add_weld: {parent: world, child: 'table::table'}}",
        "{add_model: {name: panda, file: 'package://poil_drake_panda/panda.urdf'}}",
        "{add_weld: {parent: world, child: 'panda::panda_link0'}}",
        rack and f"{{add_model: {{name: rack, file: '{rack}'}}}}",
        weld_rack and f"{{add_weld: {{parent: world, child: '{weld_rack}', X_PC: {place}}}}}",
        mug and add_mug(mug, pose_of=pose_of),
        more,
    ]
    if mug:
        poil = f"demonstration_object: '{mug}', {poil}"
    return f"{{directives: [{', '.join(filter(None, directives))}], poil: {{{poil}}}}}"


def _urdf_shape(name: str, center: Sequence[float], shape: str) -> str:
    inner = f'<origin xyz="{_text(center)}"/><geometry>{shape}</geometry>'
    return "".join(f'<{kind} name="{name}">{inner}</{kind}>' for kind in ("visual", "collision"))


def _urdf_cylinder() -> str:
    return f'<cylinder radius="{BOWL_RADIUS}" length="{BOWL_HEIGHT}"/>'


def _text(values: Sequence[float]) -> str:
    return " ".join(f"{value:.6g}" for value in values)
