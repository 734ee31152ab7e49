"""The other end of `camera_process`: builds a station and takes its pictures."""

import dataclasses
from typing import Any

import numpy as np
from pydrake.lcm import DrakeLcmParams

from poil_drake.diagrams.load_scenario import LoadScenario
from poil_drake.diagrams.station import CaptureFrame, MakeStation
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.worker_process import Answer
from poil_drake.perception.worker_service import run


class CameraService:
    """Takes pictures of a station that it puts at given positions."""

    def __init__(self, setup: tuple[str, list[str]]):
        """Builds the station.

        Args:
            setup: The scenario's text, and further `package.xml` files.
        """
        text, package_xmls = setup
        scenario = LoadScenario(data=text)
        # What is on the scenario's networks is the business of the station itself.
        silent = {name: DrakeLcmParams(lcm_url="memq://null") for name in scenario.lcm_buses}
        scenario = dataclasses.replace(scenario, lcm_buses=silent)
        self._station = MakeStation(scenario, prompt_cameras=True, package_xmls=package_xmls)
        self._context = self._station.CreateDefaultContext()

    def __call__(self, request: tuple[Any, ...]) -> Answer:
        """Answers ("warm up",), ("take", positions, time) or ("take labels", positions, time).

        Returns:
            The colour and the depth image of each camera, or the label image of each.
        """
        kind, *scene = request
        if kind == "warm up":
            CaptureFrame(self._station, self._context)
            return Answer(None)
        images = self._frame(*scene, labels=kind == "take labels").images
        if kind == "take labels":
            return Answer(None, [image.label for image in images if image.label is not None])
        return Answer(None, [array for image in images for array in (image.rgb, image.depth)])

    def _frame(self, positions: np.ndarray, time: float, *, labels: bool) -> MultiViewFrame:
        plant = self._station.plant()
        plant_context = self._station.GetMutableSubsystemContext(plant, self._context)
        plant.SetPositions(plant_context, positions)
        self._context.SetTime(time)
        return CaptureFrame(self._station, self._context, labels=labels)


if __name__ == "__main__":
    run(CameraService)
