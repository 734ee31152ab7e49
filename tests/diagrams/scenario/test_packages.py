"""Packages of the user, which `package://` paths name."""

from pathlib import Path

import pytest
from own_models import own_scenario, urdf_mug

from poil_drake.diagrams.demonstration.scene import DemonstrationScene
from poil_drake.diagrams.scenario.load import ChooseScenario, DumpScenario, LoadScenario
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station import MakeStation
from poil_drake.errors import ScenarioError

XML = '<package format="2"><name>{}</name></package>'


def write_package(folder: Path, name: str = "lab_mugs") -> None:
    """Writes a ROS package with a mug whose mesh is a path into the package."""
    (folder / "urdf").mkdir(parents=True)
    (folder / "package.xml").write_text(XML.format(name))
    mesh = f'<mesh filename="package://{name}/ball.obj"/>'
    bowl = '<cylinder radius="0.035" length="0.09"/>'
    (folder / "urdf" / "mug.urdf").write_text(urdf_mug("handle body").replace(bowl, mesh))
    square = "v -0.03 0 0\nv 0.03 0 0\nv 0 0.03 0\nv 0 0 0.09\n"
    (folder / "ball.obj").write_text(f"{square}f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")


def scenario_file(folder: Path, packages: str) -> Scenario:
    """Reads a scenario file in `folder`, with the mug of the package "lab_mugs"."""
    text = own_scenario(mug="package://lab_mugs/urdf/mug.urdf", poil=f"packages: {packages}")
    (folder / "scene.yaml").write_text(f"Own: {text}")
    return LoadScenario(filename=folder / "scene.yaml", defaults=ChooseScenario())


@pytest.mark.parametrize(
    "packages", ["[ws/src/lab_mugs/package.xml]", "[ws]", "[ws/src/lab_mugs/]"]
)
def test_a_package_is_named_by_its_file_or_a_folder_around_it(
    packages: str, tmp_path: Path
) -> None:
    write_package(tmp_path / "ws" / "src" / "lab_mugs")
    scenario = scenario_file(tmp_path, packages)

    # The process that renders cameras reads the text of the scenario.
    again = LoadScenario(data=DumpScenario(scenario, named=False))
    station = MakeStation(again, cameras=False)
    scene = DemonstrationScene(scenario, cameras=False)

    assert station.object_body().name() == "body"
    assert len(scene.boxes("mug", "handle")) == 3


@pytest.mark.parametrize(
    ("packages", "says"),
    [
        ("[]", "refers to unknown package 'lab_mugs'. .*poil.packages"),
        ("[nowhere/package.xml]", "package '.*nowhere/package.xml' cannot be used.*poil.packages"),
        ("[ws, copy/package.xml]", "'.*copy/package.xml' cannot be used.*each package once"),
        ("lab_mugs", "poil.packages' is 'lab_mugs', but a list"),
    ],
)
def test_a_package_that_cannot_be_used_is_named(packages: str, says: str, tmp_path: Path) -> None:
    write_package(tmp_path / "ws" / "src" / "lab_mugs")
    write_package(tmp_path / "copy")

    with pytest.raises(ScenarioError, match=says) as info:
        MakeStation(scenario_file(tmp_path, packages), cameras=False)

    assert "\n" not in str(info.value)
