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
    dut = HtmlRecording(meshcat, tmp_path / "new" / "run.html", title="Mug & rack")

    with dut:
        move_ball(meshcat, 64)

    page = dut.path.read_text()
    assert page.count("<title>Mug &amp; rack</title>") == 1
    assert "Drake MeshCat</title>" not in page


def test_frames_are_in_the_file(meshcat, tmp_path):
    sizes = []
    for frames in (1, 1001):
        with HtmlRecording(meshcat, tmp_path / f"{frames}.html") as dut:
            move_ball(meshcat, frames)
        sizes.append(dut.path.stat().st_size)

    # Seven doubles and a time for each pose make about a hundred bytes.
    assert 50_000 < sizes[1] - sizes[0] < 300_000


def test_the_file_is_written_when_the_run_fails(meshcat, tmp_path):
    dut = HtmlRecording(meshcat, tmp_path / "run.html")

    def fail():
        with dut:
            move_ball(meshcat, 2)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()

    assert "meshcat" in dut.path.read_text().lower()


def test_a_new_recording_forgets_the_old_one(meshcat, tmp_path):
    with HtmlRecording(meshcat, tmp_path / "long.html") as long:
        move_ball(meshcat, 1000)
    with HtmlRecording(meshcat, tmp_path / "short.html") as short:
        move_ball(meshcat, 2)

    assert short.path.stat().st_size < long.path.stat().st_size


def test_a_live_page_has_an_address():
    dut = MakeMeshcat()

    assert dut.web_url().startswith("http://localhost:")


def test_a_port_that_is_taken_is_named_in_the_error():
    with socket.socket() as other:
        other.bind(("localhost", 0))
        other.listen()
        port = other.getsockname()[1]

        with pytest.raises(StationError, match=str(port)):
            MakeMeshcat(port=port)
