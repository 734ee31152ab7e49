import dataclasses
from pathlib import Path

import numpy as np
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

import poil_drake.models
from poil_drake.errors import InvalidValueError
from poil_drake.models.mug_family import NAMED_MUGS, ROD_CLEARANCE, MugParameters
from poil_drake.models.mug_mesh import body_mesh, handle_mesh, texture_image
from poil_drake.models.mug_sdf import write_mug
from poil_drake.models.mug_shape import handle_center_line, outer_radius

SHIPPED = Path(poil_drake.models.__file__).parent / "mugs"
EACH_MUG = pytest.mark.parametrize("mug", NAMED_MUGS, ids=lambda mug: mug.name)


@EACH_MUG
def test_the_shipped_files_are_up_to_date(mug: MugParameters, tmp_path: Path) -> None:
    import cv2

    write_mug(mug, tmp_path)

    made = sorted(p.name for p in tmp_path.iterdir())
    assert made == sorted(p.name for p in (SHIPPED / mug.name).iterdir())
    for name in made:
        shipped = SHIPPED / mug.name / name
        if name.endswith(".png"):
            # Compressors differ between versions of libpng; pixels do not.
            np.testing.assert_array_equal(
                cv2.imread(str(tmp_path / name)), cv2.imread(str(shipped))
            )
        else:
            assert (tmp_path / name).read_text() == shipped.read_text()


@EACH_MUG
def test_a_rod_passes_the_handle(mug: MugParameters) -> None:
    line = handle_center_line(mug, 2000)
    inside = line[:, 0] > mug.radius + mug.handle_radius
    x, z = line[inside, 0] - mug.handle_radius, line[inside, 2]

    # The widest gap between wall and tube, and the tallest one between the tube's branches.
    assert np.max(x - outer_radius(mug, z)) >= ROD_CLEARANCE[0]
    assert np.ptp(line[:, 2]) - 2 * mug.handle_radius >= ROD_CLEARANCE[1]


@EACH_MUG
def test_drake_reads_the_model(mug: MugParameters) -> None:
    plant = MultibodyPlant(time_step=0.01)
    Parser(plant).AddModels(str(SHIPPED / mug.name / f"{mug.name}.sdf"))
    plant.Finalize()
    context = plant.CreateDefaultContext()

    center = plant.CalcCenterOfMassPositionInWorld(context)
    masses = [plant.GetBodyByName(name).default_mass() for name in ("body", "handle")]

    assert plant.num_positions() == 7
    assert sum(masses) == pytest.approx(mug.mass)
    # The handle stands at +x and is a tenth of the mass; the bottom is heavier than the rim.
    assert 0 < center[0] < 0.25 * mug.radius
    assert center[1] == pytest.approx(0, abs=1e-9)
    assert 0.25 * mug.height < center[2] < 0.5 * mug.height


@EACH_MUG
@pytest.mark.parametrize("make", [body_mesh, handle_mesh])
def test_a_mesh_faces_outwards(make, mug: MugParameters) -> None:
    dut = make(mug)

    corners = dut.vertices[dut.faces]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    given = dut.normals[dut.faces].mean(axis=1)
    np.testing.assert_allclose(np.linalg.norm(dut.normals, axis=1), 1, atol=1e-6)
    assert np.all(np.einsum("ij,ij->i", facing, given) > 0)
    assert np.all((dut.uv >= 0) & (dut.uv <= 1))


def test_the_body_encloses_the_volume_of_its_clay() -> None:
    mug = MugParameters(name="straight", taper=1.0, radius=0.04, height=0.1, wall=0.004)

    dut = body_mesh(mug)

    a, b, c = (dut.vertices[dut.faces[:, i]] for i in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
    # A tube and a disc 1.6 times as thick; the polygon and the rounded edges take some per cent.
    tube = np.pi * (0.04**2 - 0.036**2) * 0.1
    disc = np.pi * 0.036**2 * 1.6 * 0.004
    assert volume == pytest.approx(tube + disc, rel=0.06)


def test_textures_depend_on_the_seed_only() -> None:
    mugs = [m for m in NAMED_MUGS if m.texture == "noise"]
    dut = texture_image(mugs[0])
    other = texture_image(dataclasses.replace(mugs[0], seed=99))

    np.testing.assert_array_equal(dut, texture_image(mugs[0]))
    assert np.any(dut != other)


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("radius", 0.2, "between 0.032 and 0.045"),
        ("handle_opening", 0.08, "does not fit"),
        ("handle_clearance", 0.01, "between 0.026"),
    ],
)
def test_an_impossible_mug_is_refused(field: str, value: object, says: str) -> None:
    with pytest.raises(InvalidValueError, match=says):
        MugParameters(name="odd", **{field: value})
