import socket

import pytest
from pydrake.geometry import Meshcat, MeshcatParams, Sphere
from pydrake.math import RigidTransform

from poil_drake.diagrams.run.html_recording import HtmlRecording, MakeMeshcat
from poil_drake.errors import StationError


@pytest.fixture(scope="module")
def meshcat():
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    meshcat.SetObject("/ball", Sphere(0.1))
    return meshcat


def move_ball(meshcat, frames):
    for frame in range(frames):
        meshcat.SetTransform("/ball", RigidTransform([0.0, 0.0, 0.01 * frame]), frame / 32)


def test_a_recording_is_written_with_its_title(meshcat, tmp_path):
    with HtmlRecording(meshcat, tmp_path / "new" / "run.html", title="Mug & rack") as path:
        move_ball(meshcat, 64)

    page = path.read_text()
    assert page.count("<title>Mug &amp; rack</title>") == 1
    assert "Drake MeshCat</title>" not in page


def test_a_file_holds_the_frames_of_its_recording_only(meshcat, tmp_path):
    sizes = []
    for frames in (1001, 1):
        with HtmlRecording(meshcat, tmp_path / f"{frames}.html") as path:
            move_ball(meshcat, frames)
        sizes.append(path.stat().st_size)

    # Seven doubles and a time for each pose make about a hundred bytes.
    assert 50_000 < sizes[0] - sizes[1] < 300_000


def test_the_file_is_written_when_the_run_fails(meshcat, tmp_path):
    path = tmp_path / "run.html"

    with pytest.raises(ZeroDivisionError), HtmlRecording(meshcat, path):
        raise ZeroDivisionError

    assert "meshcat" in path.read_text().lower()


def test_a_live_page_has_an_address():
    dut = MakeMeshcat()

    assert dut.web_url().startswith("http://localhost:")


def test_the_error_names_a_port_that_is_taken():
    with socket.socket() as other:
        other.bind(("localhost", 0))
        other.listen()
        port = other.getsockname()[1]

        with pytest.raises(StationError, match=str(port)):
            MakeMeshcat(port=port)
