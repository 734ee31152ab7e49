"""Meshes as people have them: without normals, in millimetres, in other formats."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from own_models import own_scenario, sdf_file, sdf_mug, sdf_shape

from poil_drake.diagrams.demonstration.recorder import MakeDemonstrationMotion
from poil_drake.diagrams.demonstration.scene import DemonstrationScene
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.diagrams.station.station import CaptureFrame, MakeStation
from poil_drake.errors import ScenarioError

BOX = "1 2 4 3;5 7 8 6;1 5 6 2;3 4 8 7;1 3 7 5;2 6 8 4"


def quads(center: tuple[float, float, float], size: tuple[float, float, float]) -> str:
    """Returns a box as OBJ, without normals."""
    signs = [(i, j, k) for i in (-0.5, 0.5) for j in (-0.5, 0.5) for k in (-0.5, 0.5)]
    corners = np.array(center) + np.array(signs) * size
    vertices = "".join("v {:.4f} {:.4f} {:.4f}\n".format(*corner) for corner in corners)
    return vertices + "".join(f"f {face}\n" for face in BOX.split(";"))


GRIP = quads((0.06, 0.0, 0.045), (0.05, 0.014, 0.07))


def write_mug(folder: Path, mesh: str, scale: str = "1 1 1", *, collides: bool = False) -> Path:
    """Writes a mug whose handle is the visual mesh `mesh`; returns its file."""
    uri = f"<mesh><uri>{mesh}</uri><scale>{scale}</scale></mesh>"
    grip = sdf_shape("grip", (0, 0, 0), uri, kinds=("visual", "collision")[: 1 + collides])
    file = folder / "mug.sdf"
    file.write_text(sdf_file(sdf_mug(grip=grip)))
    return file


def handle_pixels(file: Path) -> tuple[int, int]:
    """Returns the number of pixels of the handle in the station's images, and of its colours."""
    station = MakeStation(ChooseScenario(data=own_scenario(mug=file)), ignore_output_delay=True)
    frame = CaptureFrame(station, station.CreateDefaultContext(), labels=True)
    [handle] = frame.label_ids["mug/handle"]
    seen = [image.rgb[image.label == handle] for image in frame.images]
    colours = np.unique(np.concatenate(seen), axis=0)
    return sum(map(len, seen)), len(colours)


@pytest.mark.render
@pytest.mark.parametrize("normals", ["none", "of one face", "of all faces"])
def test_an_obj_without_normals_is_drawn_like_one_with_them(normals: str, tmp_path: Path) -> None:
    text = GRIP
    if normals == "of one face":
        text = GRIP.replace("f 1 2 4 3", "vn -1 0 0\nf 1//1 2//1 4//1 3//1")
    (tmp_path / "grip.obj").write_text(text)
    if normals == "of all faces":
        # As another library exports it.
        mesh = trimesh.load_mesh(tmp_path / "grip.obj")
        mesh.unmerge_vertices()
        mesh.export(tmp_path / "grip.obj", include_normals=True)

    pixels, colours = handle_pixels(write_mug(tmp_path, "grip.obj"))

    box = sdf_shape("grip", (0.06, 0.0, 0.045), "<box><size>0.05 0.014 0.07</size></box>")
    (tmp_path / "box.sdf").write_text(sdf_file(sdf_mug(grip=box)))
    expected, expected_colours = handle_pixels(tmp_path / "box.sdf")
    assert pixels == pytest.approx(expected, rel=0.01)
    # Faces are shaded by their normals, as those of Drake's own box.
    assert abs(colours - expected_colours) <= 3


@pytest.mark.render
@pytest.mark.parametrize("part", ["handle", "!PartRegion {lower: [0.04, -.inf, -.inf]}"])
def test_materials_and_relative_indices_are_kept(part: str, tmp_path: Path) -> None:
    (tmp_path / "paint.mtl").write_text("newmtl red\nKd 0.9 0 0\nnewmtl blue\nKd 0 0 0.9\n")
    # Indices from the end of the eight vertices; the ends of the box in y are blue.
    vertices, faces = GRIP[: GRIP.index("f")], GRIP[GRIP.index("f") :]
    for index in range(8, 0, -1):
        faces = faces.replace(f" {index}", f" -{9 - index}")
    ends = faces.splitlines()[2:4]
    red = "\n".join(line for line in faces.splitlines() if line not in ends)
    blue = "\n".join(ends)
    text = f"mtllib paint.mtl\n{vertices}usemtl red\n{red}\nusemtl blue\n{blue}\n"
    (tmp_path / "grip.obj").write_text(text)
    mug = write_mug(tmp_path, "grip.obj")
    data = own_scenario(mug=mug, poil=f"parts: {{handle: {part}}}")
    station = MakeStation(ChooseScenario(data=data), ignore_output_delay=True)

    frame = CaptureFrame(station, station.CreateDefaultContext(), labels=True)

    [handle] = frame.label_ids["mug/handle"]
    colours = np.concatenate([image.rgb[image.label == handle] for image in frame.images])
    # Edges mix with what is behind them.
    for channel in (0, 2):
        pure = colours[(colours > 0).sum(axis=1) == 1][:, channel]
        assert np.count_nonzero(pure > 100) > 100


@pytest.mark.render
@pytest.mark.parametrize("suffix", ["stl", "STL", "ply"])
def test_other_formats_are_drawn(suffix: str, tmp_path: Path) -> None:
    box = trimesh.creation.box((0.05, 0.014, 0.07))
    box.apply_translation((0.06, 0.0, 0.045))
    box.export(tmp_path / f"grip.{suffix}", file_type=suffix.lower())
    (tmp_path / "grip.obj").write_text(GRIP)

    pixels, _ = handle_pixels(write_mug(tmp_path, f"grip.{suffix}"))

    assert pixels == pytest.approx(handle_pixels(write_mug(tmp_path, "grip.obj"))[0], rel=0.01)


@pytest.mark.parametrize(
    ("name", "text", "collides", "says"),
    [
        ("grip.dae", "<COLLADA/>", False, r"grip.dae of 'mug::grip' has a format.*to \.obj"),
        ("grip.stl", "solid a\nendsolid a\n", True, r"grip.stl.*\.export\("),
        ("grip.obj", "v 0 0 0\nf 1 2 3\n", False, "grip.obj of 'mug::grip' cannot be read"),
        ("grip.obj", "v 0 a 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", False, "cannot be read"),
        ("grip.obj", GRIP.replace("f 1 ", "f 99 "), True, "grip.obj of 'mug::grip' cannot be"),
        ("grip.obj", GRIP.replace("v 0", "v nan", 1), True, "grip.obj of 'mug::grip' cannot be"),
        ("other.obj", GRIP, True, "grip.obj.*does not exist. Correct the path"),
    ],
)
def test_a_mesh_that_cannot_be_used_is_named(
    name: str, text: str, collides: bool, says: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_text(text)
    mesh = "grip.obj" if name == "other.obj" else name
    file = write_mug(tmp_path, mesh, collides=collides)

    with pytest.raises(ScenarioError, match=says) as info:
        MakeStation(ChooseScenario(data=own_scenario(mug=file)), cameras=False)

    assert "\n" not in str(info.value)


MILLIMETRES = quads((60, 0, 45), (50, 14, 70))


@pytest.mark.parametrize("collides", [True, False])
@pytest.mark.parametrize("make", [MakeStation, DemonstrationScene])
def test_a_mesh_in_millimetres_is_recognized(make, collides: bool, tmp_path: Path) -> None:
    (tmp_path / "grip.obj").write_text(MILLIMETRES)
    scenario = ChooseScenario(
        data=own_scenario(mug=write_mug(tmp_path, "grip.obj", collides=collides))
    )

    with pytest.raises(
        ScenarioError, match=r"grip.obj of 'mug::grip' is 70 m .*0\.001.* millimetres"
    ):
        make(scenario, cameras=False)


def test_the_remedy_for_millimetres_helps(tmp_path: Path) -> None:
    (tmp_path / "grip.obj").write_text(MILLIMETRES)
    file = write_mug(tmp_path, "grip.obj", "0.001 0.001 0.001", collides=True)

    scene = DemonstrationScene(ChooseScenario(data=own_scenario(mug=file)), cameras=False)

    [(_, half)] = scene.boxes("mug", "handle")
    np.testing.assert_allclose(sorted(2 * half), [0.014, 0.05, 0.07], atol=1e-6)


@pytest.mark.parametrize(
    ("scale", "says"),
    [
        # In centimetres; and scaled twice.
        ("100 100 100", r"'mug' is 8.5 m large.*units"),
        ("0.001 0.001 0.001", r"'mug' is 0.085 mm large"),
    ],
)
def test_an_object_that_no_hand_can_hold_is_refused(scale: str, says: str, tmp_path: Path) -> None:
    (tmp_path / "cup.obj").write_text(quads((0.0, 0.0, 0.045), (0.07, 0.07, 0.085)))
    mass = '<inertial><mass value="0.2"/><inertia ixx="2e-4" iyy="2e-4" izz="2e-4" ixy="0" '
    mass += 'ixz="0" iyz="0"/></inertial>'
    mesh = f'<geometry><mesh filename="cup.obj" scale="{scale}"/></geometry>'
    shapes = f'<visual name="a">{mesh}</visual><collision name="a">{mesh}</collision>'
    file = tmp_path / "mug.urdf"
    file.write_text(f'<robot name="cup"><link name="body">{mass}{shapes}</link></robot>')
    scenario = ChooseScenario(data=own_scenario(mug=file, poil="part: body"))

    with pytest.raises(ScenarioError, match=says):
        MakeStation(scenario, cameras=False)


def test_a_part_without_collision_geometry_is_told_what_collides(tmp_path: Path) -> None:
    (tmp_path / "grip.obj").write_text(GRIP)
    file = write_mug(tmp_path, "grip.obj")
    scene = DemonstrationScene(ChooseScenario(data=own_scenario(mug=file)), cameras=False)

    with pytest.raises(ScenarioError, match=r"'handle' .*no collision.*links \(body\).*\(bowl\)"):
        MakeDemonstrationMotion(scene, ChooseScenario().poil.demonstration_motion)


def test_a_rod_without_collision_geometry_is_told_what_collides(tmp_path: Path) -> None:
    rod = "<capsule><radius>0.005</radius><length>0.1</length></capsule>"
    shapes = sdf_shape("rod", (0, 0, 0.2), rod, kinds=("visual",))
    shapes += sdf_shape("post", (0, 0, 0.1), rod)
    model = f'<model name="rack"><link name="stand">{shapes}</link></model>'
    (tmp_path / "rack.sdf").write_text(sdf_file(model))
    text = own_scenario(rack=tmp_path / "rack.sdf")

    with pytest.raises(ScenarioError, match=r"rod is 'rod'.*\(stand\).*\(post\).*only visual"):
        MakeStation(ChooseScenario(data=text), cameras=False)
