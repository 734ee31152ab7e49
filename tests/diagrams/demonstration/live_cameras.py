"""Small cameras of a scenario, and stand-ins that deliver known images for them."""

import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.cameras.cameras import MakeCameraModels
from poil_drake.diagrams.station.station_models import MakeUnsimulatedPlant
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage
from poil_drake.recording.demonstration.demonstration import Demonstration
from poil_drake.recording.demonstration.writer import DemonstrationWriter
from poil_drake.recording.mcap.message_encoder import ColorEncoding
from poil_drake.systems.cameras.lcm_image_messages import encode_images
from poil_drake.systems.lcm.network import LcmNetwork

WIDTH, HEIGHT = 64, 48
FPS = 30.0
MUG = 77
"""The mug's number in the label images that are sent."""


def scenario_text(
    url: str, sources: str = "", *, robot_url: str = "memq://", ready_timeout: float = 60.0
) -> str:
    """Returns the YAML of small cameras "left" and "right" with sources and LCM network `url`."""
    size = f"width: {WIDTH}, height: {HEIGHT}"
    return (
        f"{{lcm_buses: {{robot: {{lcm_url: '{robot_url}'}}, images: {{lcm_url: '{url}'}}}}, "
        f"cameras: {{left: {{{size}}}, right: {{{size}}}}}, "
        "poil: {safety: {image_age_limit: 0.4}, "
        f"hardware: {{ready_timeout: {ready_timeout}, cameras: {{{sources}}}}}}}}}"
    )


def camera_models(scenario: Scenario) -> tuple[CameraModel, ...]:
    plant, _, _ = MakeUnsimulatedPlant(scenario)
    return MakeCameraModels(plant, scenario.cameras)


def noise(number: int, *, stamp: float = 0.0, labelled: bool = False) -> RgbdImage:
    """Returns an image that cannot be compressed; its depth is in whole millimetres."""
    rgb, depth = _pixels(number)
    label = np.full((HEIGHT, WIDTH), MUG, np.int16) if labelled else None
    return RgbdImage(rgb, depth, stamp, label)


@cache
def _pixels(number: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(number)
    rgb = rng.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
    return rgb, rng.integers(300, 3000, (HEIGHT, WIDTH)).astype(np.float32) / np.float32(1000.0)


class LcmSender:
    """Sends numbered images of cameras from a thread, and can be unplugged.

    Attributes:
        sent: Stamp [ms] -> number of each image sent.
        plugged: Whether images are sent; clear it to unplug the cameras.
    """

    def __init__(self, url: str, cameras: Sequence[str], *, label_every: int):
        self.sent: dict[int, int] = {}
        self.plugged = threading.Event()
        self.plugged.set()
        self._ended = threading.Event()
        self._lcm, self._cameras, self._label_every = LcmNetwork(url), cameras, label_every
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        number = 0
        while not self._ended.wait(1.0 / FPS):
            if not self.plugged.is_set():
                continue
            labelled = self._label_every > 0 and number % self._label_every == 0
            milliseconds = round(1e3 * time.time())
            image = noise(number, stamp=1e-3 * milliseconds, labelled=labelled)
            self.sent[milliseconds] = number
            for camera in self._cameras:
                self._lcm.Publish(
                    f"DRAKE_RGBD_CAMERA_IMAGES_{camera}", encode_images(image, camera=camera)
                )
            number += 1


@contextmanager
def lcm_sender(
    url: str, cameras: Sequence[str] = ("left", "right"), *, label_every: int = 0
) -> Iterator[LcmSender]:
    sender = LcmSender(url, cameras, label_every=label_every)
    try:
        yield sender
    finally:
        sender.close()


def write_streams(folder: Path, count: int) -> str:
    """Writes numbered PNG files, and returns the source of a camera that reads them."""
    for k in range(count):
        image = noise(k)
        cv2.imwrite(str(folder / f"rgb_{k:04d}.png"), image.rgb[:, :, ::-1])
        depth = np.rint(1000.0 * image.depth).astype(np.uint16)
        cv2.imwrite(str(folder / f"depth_{k:04d}.png"), depth)
    return f"!OpenCvStreams {{rgb: '{folder}/rgb_%04d.png', depth: '{folder}/depth_%04d.png'}}"


def write_playback(path: Path, camera: CameraModel, count: int) -> str:
    """Writes a demonstration, and returns the source of a camera that plays it in a loop."""
    with DemonstrationWriter(
        path, [camera.name], {}, color=ColorEncoding(format="raw"), exact_depth=True
    ) as writer:
        for k in range(count):
            image = noise(k, stamp=k / FPS, labelled=k == 0)
            writer.write(MultiViewFrame((camera,), (image,), {"mug": (MUG,)}))
    return f"!McapPlayback {{file: '{path}', loop: true}}"


def small_scenario(url: str, sources: str = "", **options: Any) -> Scenario:
    return ChooseScenario(data=scenario_text(url, sources, **options))


def images_of(recording: Demonstration, camera: str) -> list[RgbdImage]:
    """Returns the images of a camera in the frames of a recording."""
    index = [model.name for model in recording.cameras].index(camera)
    return [frame.images[index] for frame in recording.frames]


def sent_numbers(recording: Demonstration, camera: str, sent: dict[int, int]) -> list[int]:
    """Returns the numbers of a camera's images by their stamps, after comparing every pixel."""
    numbers = []
    for image in images_of(recording, camera):
        numbers.append(sent[round(1e3 * image.stamp)])
        assert abs(1e3 * image.stamp - round(1e3 * image.stamp)) < 1e-2
        expected = noise(numbers[-1])
        np.testing.assert_array_equal(image.rgb, expected.rgb)
        np.testing.assert_array_equal(image.depth, expected.depth)
    return numbers


def number_of(image: RgbdImage, count: int) -> int:
    """Returns which of the first `count` images this is, by its pixels."""
    (number,) = [
        k
        for k in range(count)
        if np.array_equal(image.rgb, noise(k).rgb) and np.array_equal(image.depth, noise(k).depth)
    ]
    return number
