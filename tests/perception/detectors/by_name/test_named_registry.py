import threading
from collections.abc import Iterator
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, HTTPServer

import numpy as np
import pytest
import yaml

from poil_drake.diagrams.scenario.typed_yaml import merge_yaml
from poil_drake.errors import (
    DetectionError,
    InvalidValueError,
    MissingDependencyError,
    ScenarioError,
)
from poil_drake.perception.detectors.by_name import registry
from poil_drake.perception.detectors.by_name.config import (
    GroundingDino,
    NamedDetectorConfig,
    OpenAiServer,
    RexOmni,
    Sam3,
)
from poil_drake.perception.detectors.by_name.registry import make_named_detector
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage
from poil_drake.perception.segmenters.config import GrabCut, Sam2

SERVER = OpenAiServer(url="http://127.0.0.1:1/v1", model="qwen")


@pytest.fixture(autouse=True)
def none_running(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(registry, "_RUNNING", {})
    yield
    for detector in registry._RUNNING.values():
        detector.close()


def test_equal_configurations_share_a_process() -> None:
    first, again, other = (
        make_named_detector(NamedDetectorConfig(finder=SERVER, words={"mug": words}))
        for words in ("cup", "cup", "bowl")
    )

    assert first is again is not other
    assert first.pid is None  # It starts when it is needed.


class Refusing(BaseHTTPRequestHandler):
    """Refuses all requests."""

    def do_POST(self) -> None:
        self.send_error(404)

    def log_message(self, *_: object) -> None:
        pass


def test_the_process_loads_the_models_and_asks_them() -> None:
    camera = CameraModel("left", 60, 40, np.eye(3), np.eye(4))
    image = RgbdImage(np.zeros((40, 60, 3)), np.ones((40, 60)), stamp=0.0)
    frame = MultiViewFrame((camera,), (image,))

    with HTTPServer(("127.0.0.1", 0), Refusing) as server:
        thread = threading.Thread(target=server.handle_request)
        thread.start()
        url = f"http://127.0.0.1:{server.server_address[1]}/v1"
        dut = make_named_detector(NamedDetectorConfig(finder=replace(SERVER, url=url)))
        with pytest.raises(DetectionError, match=rf"{url} gave no boxes \(status 404"):
            dut.detect(frame, object_label="mug", part_label="handle")
        thread.join()

    assert dut.pid is not None


@pytest.mark.parametrize(
    ("config", "error", "problem"),
    [
        (NamedDetectorConfig(), MissingDependencyError, "weights .* of GroundingDino"),
        (NamedDetectorConfig(finder=RexOmni()), InvalidValueError, "RexOmni.accept_licence"),
        (
            NamedDetectorConfig(finder=SERVER, segmenter=Sam2()),
            MissingDependencyError,
            "weights .* of Sam2",
        ),
        (NamedDetectorConfig(finder=OpenAiServer()), InvalidValueError, "model is empty"),
    ],
)
def test_what_is_missing_is_said_before_a_process_starts(
    config: NamedDetectorConfig, error: type[Exception], problem: str
) -> None:
    with pytest.raises(error, match=problem):
        make_named_detector(config)


def read(text: str) -> NamedDetectorConfig:
    return merge_yaml(yaml.load(text, Loader), NamedDetectorConfig, NamedDetectorConfig(), path="x")


class Loader(yaml.SafeLoader):
    """Reads tagged mappings as Drake's loader does."""


Loader.add_multi_constructor(
    "!", lambda loader, tag, node: {**loader.construct_mapping(node), "_tag": f"!{tag}"}
)


@pytest.mark.parametrize(
    ("text", "config"),
    [
        ("{}", NamedDetectorConfig()),
        (
            "{finder: {threshold: 0.4}, words: {mug_7: white mug}, one_grid: false}",
            NamedDetectorConfig(
                finder=GroundingDino(threshold=0.4), words={"mug_7": "white mug"}, one_grid=False
            ),
        ),
        (
            "{finder: !RexOmni {weights: /models/rex, accept_licence: true, device: 'cuda:1'}, "
            "segmenter: !Sam2 {}}",
            NamedDetectorConfig(
                finder=RexOmni(weights="/models/rex", accept_licence=True, device="cuda:1"),
                segmenter=Sam2(),
            ),
        ),
        (
            "{finder: !OpenAiServer {model: qwen, thousandths: true}, segmenter: !GrabCut {}}",
            NamedDetectorConfig(
                finder=OpenAiServer(model="qwen", thousandths=True), segmenter=GrabCut()
            ),
        ),
        (
            "{finder: !Sam3 {threshold: 0.6}, timeout: 20}",
            NamedDetectorConfig(finder=Sam3(threshold=0.6), timeout=20.0),
        ),
    ],
)
def test_yaml_chooses_models_by_tags(text: str, config: NamedDetectorConfig) -> None:
    assert read(text) == config


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("{finder: !Owl {}}", "GroundingDino, !RexOmni, !Sam3, !OpenAiServer"),
        ("{finder: !Sam3 {threshold: 2}}", r"x\.finder\.threshold is 2"),
        ("{finder: !OpenAiServer {url: 'localhost:8000'}}", r"x\.finder\.url is 'localhost:8000'"),
        ("{timeout: 0}", r"x\.timeout is 0"),
    ],
)
def test_mistakes_in_yaml_are_named(text: str, problem: str) -> None:
    with pytest.raises(ScenarioError, match=problem):
        read(text)
