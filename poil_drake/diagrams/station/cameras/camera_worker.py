"""The worker process of `camera_process`: builds a station and renders its cameras."""

import dataclasses
from typing import Any

import numpy as np
from pydrake.lcm import DrakeLcmParams

from poil_drake.diagrams.scenario.load import LoadScenario
from poil_drake.diagrams.scenario.scenario import NO_NETWORK
from poil_drake.diagrams.station.cameras.incremental_renderer import IncrementalRenderer
from poil_drake.diagrams.station.station import MakeStation
from poil_drake.perception.images import RgbdImage
from poil_drake.runtime.worker_process import serve


class CameraService:
    """Builds a station, and renders its cameras at requested positions of its plant."""

    def __init__(self, setup: tuple[str, list[str]]):
        """Builds the station from `setup`: the scenario as YAML and further `package.xml` files."""
        text, package_xmls = setup
        scenario = LoadScenario(data=text)
        # Only the original station uses the scenario's networks.
        silent = {name: DrakeLcmParams(lcm_url=NO_NETWORK) for name in scenario.lcm_buses}
        scenario = dataclasses.replace(scenario, lcm_buses=silent)
        self._station = MakeStation(scenario, ignore_output_delay=True, package_xmls=package_xmls)
        self._context = self._station.CreateDefaultContext()
        self._renderer = IncrementalRenderer(
            self._station, self._station.scene_graph(), self._station.camera_names
        )

    def __call__(self, request: tuple[Any, ...]) -> dict[str, RgbdImage] | dict[str, np.ndarray]:
        """Answers ("warm up",), ("render", positions, time) or ("render labels", positions, time).

        See `SceneRenderer` for the positions and the time.

        Returns:
            The image or the label image of each camera by its name; nothing for "warm up".
        """
        kind, *scene = request
        if kind == "warm up":
            self._renderer.capture(self._context)
            return {}
        positions, time = scene
        plant = self._station.plant()
        plant_context = self._station.GetMutableSubsystemContext(plant, self._context)
        plant.SetPositions(plant_context, positions)
        self._context.SetTime(time)
        if kind == "render labels":
            return {name: self._labels(name) for name in self._station.camera_names}
        return self._renderer.capture(self._context)

    def _labels(self, camera: str) -> np.ndarray:
        port = self._station.GetOutputPort(f"{camera}.label_image")
        return port.Eval(self._context).data[:, :, 0]


if __name__ == "__main__":
    serve(CameraService)
