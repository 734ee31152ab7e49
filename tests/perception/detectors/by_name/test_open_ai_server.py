import base64
import json
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import cv2
import numpy as np
import pytest
import requests
from hypothesis import given
from hypothesis import strategies as st

from poil_drake.errors import DetectionError, InvalidValueError
from poil_drake.perception.detectors.by_name import open_ai_server
from poil_drake.perception.detectors.by_name.config import OpenAiServer
from poil_drake.perception.detectors.by_name.open_ai_server import OpenAiServerFinder, parse_boxes

IMAGE = np.full((100, 210, 3), (250, 10, 40), dtype=np.uint8)  # Sent as 112 x 224 pixels.
BOXES = '[{"bbox_2d": [28, 28, 112, 56]}]'

Answer = Callable[["Handler"], None]


class Server(ThreadingHTTPServer):
    """Gives one answer to each request, the last one to all further requests."""

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.answers: list[Answer] = []
        self.requests: list[tuple[str, str | None, Any]] = []
        self.ended = threading.Event()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}/v1"


class Handler(BaseHTTPRequestHandler):
    server: Server

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        requests, answers = self.server.requests, self.server.answers
        requests.append((self.path, self.headers["Authorization"], json.loads(body)))
        answers[min(len(requests), len(answers)) - 1](self)

    def reply(self, body: str, status: int = 200, length: int | None = None) -> None:
        data = body.encode()
        self.send_response(status)
        self.send_header("Content-Length", str(len(data) if length is None else length))
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, *_: object) -> None:
        pass


def says(text: object) -> Answer:
    """Answers with a message of the model."""
    completion = json.dumps({"choices": [{"message": {"role": "assistant", "content": text}}]})
    return lambda handler: handler.reply(completion)


def stalls(handler: Handler) -> None:
    handler.server.ended.wait()


def stalls_in_the_middle(handler: Handler) -> None:
    handler.reply('{"choices": [', length=1000)
    handler.server.ended.wait()


def truncates(handler: Handler) -> None:
    handler.reply('{"choices": [', length=1000)
    handler.close_connection = True


def sends(body: str, status: int = 200) -> Answer:
    return lambda handler: handler.reply(body, status)


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    monkeypatch.setattr(open_ai_server, "_BACK_OFF", 0.0)
    with Server() as running:
        thread = threading.Thread(target=running.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield running
        running.ended.set()
        running.shutdown()
        thread.join()


def finder(server: Server, **options: Any) -> OpenAiServerFinder:
    return OpenAiServerFinder(OpenAiServer(url=server.url, model="qwen", **options))


def test_boxes_come_back_in_pixels_of_the_image(server: Server) -> None:
    server.answers = [says(BOXES)]

    boxes = finder(server).find(IMAGE, "handle")

    scale = [210 / 224, 100 / 112] * 2
    np.testing.assert_allclose(boxes.corners, [np.multiply([28, 28, 112, 56], scale)])


def test_the_request_holds_the_image_the_name_and_the_model(server: Server) -> None:
    server.answers = [says("[]")]

    finder(server).find(IMAGE, "handle")

    [(path, key, request)] = server.requests
    assert (path, key, request["model"]) == ("/v1/chat/completions", None, "qwen")
    picture, text = request["messages"][0]["content"]
    assert "every handle in this image of 224 x 112 pixels" in text["text"]
    head, _, data = picture["image_url"]["url"].partition(",")
    assert head == "data:image/png;base64"
    sent = cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR_RGB)
    np.testing.assert_array_equal(sent, np.broadcast_to(IMAGE[0, 0], (112, 224, 3)))


def test_coordinates_may_be_thousandths_of_the_image(server: Server) -> None:
    server.answers = [says('[{"bbox_2d": [100, 200, 500, 1000]}]')]

    boxes = finder(server, thousandths=True).find(IMAGE, "handle")

    np.testing.assert_allclose(boxes.corners, [[21, 20, 105, 100]])


def test_the_key_comes_from_the_environment(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MY_KEY", "abc")
    server.answers = [says("[]")]

    finder(server, key_variable="MY_KEY").find(IMAGE, "handle")

    assert server.requests[0][1] == "Bearer abc"


@pytest.mark.parametrize(
    ("options", "problem"),
    [({"model": ""}, "model is empty"), ({"key_variable": "NOT_SET"}, "NOT_SET .* no API key")],
)
def test_an_incomplete_configuration_is_rejected(options: dict[str, str], problem: str) -> None:
    with pytest.raises(InvalidValueError, match=problem):
        OpenAiServerFinder(OpenAiServer(**{"model": "qwen", **options}))


@pytest.mark.parametrize(
    "fault",
    [
        truncates,
        sends("out of memory", status=500),
        sends("too many requests", status=429),
        sends("<html>"),
        sends('{"error": "busy"}'),
        says(None),
        says("I see a handle."),
        says('[{"bbox_2d": [1, 2, 3]}]'),
    ],
)
def test_after_a_fault_the_next_attempt_counts(server: Server, fault: Answer) -> None:
    server.answers = [fault, says(BOXES)]

    boxes = finder(server, timeout=600.0).find(IMAGE, "handle")

    assert len(boxes.corners) == 1
    assert len(server.requests) == 2


@pytest.mark.parametrize("stall", [stalls, stalls_in_the_middle])
def test_a_server_that_stalls_is_asked_again(
    server: Server, stall: Answer, monkeypatch: pytest.MonkeyPatch
) -> None:
    post = requests.post

    def wait_only_for_the_stall(url: str, *, timeout: float, **options: Any) -> requests.Response:
        return post(url, timeout=600.0 if server.requests else timeout, **options)

    monkeypatch.setattr(requests, "post", wait_only_for_the_stall)
    server.answers = [stall, says(BOXES)]

    boxes = finder(server, timeout=0.1).find(IMAGE, "handle")

    assert len(boxes.corners) == 1


@pytest.mark.parametrize(
    ("fault", "reason"),
    [(stalls, "Read timed out"), (truncates, "IncompleteRead"), (says("Yes!"), "no JSON list")],
)
def test_three_faults_end_in_an_error_with_the_reason(
    server: Server, fault: Answer, reason: str
) -> None:
    server.answers = [fault]

    with pytest.raises(DetectionError, match=reason) as raised:
        finder(server, timeout=0.2 if fault is stalls else 600.0).find(IMAGE, "handle")

    assert server.url in raised.value.problem
    assert len(server.requests) == 3


def test_a_refused_request_is_not_repeated(server: Server) -> None:
    server.answers = [sends("no such model", status=404)]

    with pytest.raises(DetectionError, match="status 404: no such model"):
        finder(server).find(IMAGE, "handle")

    assert len(server.requests) == 1


def test_a_server_that_does_not_run_is_named(server: Server) -> None:
    dut = finder(server)
    server.server_close()

    with pytest.raises(DetectionError, match=r"gave no boxes .*Connect"):
        dut.find(IMAGE, "handle")


@pytest.mark.parametrize(
    "text",
    [
        "[[1, 2, 3.5, 4]]",
        'Sure!\n```json\n[{"bbox_2d": [1, 2, 3.5, 4], "label": "a [long] handle"}]\n```',
        '{"boxes": [{"bbox_2d": [1, 2, 3.5, 4]}]}',
        '{"notes": [], "boxes": [[1, 2, 3.5, 4]]}',
        "The box [in pixels] is [[1, 2, 3.5, 4]].",
    ],
)
def test_a_list_of_boxes_is_read_wherever_it_is(text: str) -> None:
    assert parse_boxes(text).tolist() == [[1, 2, 3.5, 4]]


@pytest.mark.parametrize(
    "text",
    [
        '[{"bbox_2d": [1, 2, 3, "4"]}]',
        '[{"bbox_2d": [1, 2, 3, NaN]}]',
        '[{"bbox_2d": [1, 2, 3, true]}]',
        '[{"bbox_2d": [1, 2, 3, 1e300]}]',
        '[{"box": [1, 2, 3, 4]}]',
        "[1, 2, 3, 4",
        "",
    ],
)
def test_anything_else_is_not_read(text: str) -> None:
    with pytest.raises(open_ai_server._AttemptFailedError):
        parse_boxes(text)


json_values = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.just("bbox_2d"), inner),
)


@given(json_values.map(json.dumps) | st.text('[]{},:"1aN '))
def test_any_text_gives_boxes_or_the_error(text: str) -> None:
    try:
        boxes = parse_boxes(text)
    except open_ai_server._AttemptFailedError:
        return
    assert boxes.shape[1:] == (4,)
    assert np.all(np.isfinite(boxes))
