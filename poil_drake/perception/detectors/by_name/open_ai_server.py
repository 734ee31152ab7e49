"""Finds boxes by a vision-language model behind an OpenAI-compatible server."""

import base64
import json
import os
import re
import time
from typing import Any

import cv2
import numpy as np

from poil_drake.errors import DetectionError, InvalidValueError
from poil_drake.perception.detectors.by_name.config import OpenAiServer
from poil_drake.perception.detectors.by_name.protocol import Boxes

_PROMPT = (
    "Find every {label} in this image of {width} x {height} pixels. Answer with a JSON list alone: "
    'one {{"bbox_2d": [x0, y0, x1, y1]}} for each, with coordinates in {unit}; [] if there is none.'
)

_PATCH = 28
"""Models of the Qwen family count pixels after resizing to a multiple of this, so the image is
resized before it is sent."""

_MOST_TOKENS = 1024
_ATTEMPTS = 3
_BACK_OFF = 1.0  # Pause after the first failed attempt [s]; doubled after each further one.
_BUSY = 429  # Too many requests.


class _AttemptFailedError(Exception):
    """An attempt failed in a way that a further one may mend."""


class OpenAiServerFinder:
    """Asks a server for boxes; a `BoxFinder`. The model gives no scores."""

    def __init__(self, config: OpenAiServer):
        """Constructs the finder, without contacting the server.

        Raises:
            InvalidValueError: if the config names no model, or a variable without an API key.
        """
        if not config.model:
            raise InvalidValueError(
                "OpenAiServer.model is empty.", remedy=f"Set one of those that {config.url} serves."
            )
        self._config = config
        self._headers = {}
        if config.key_variable:
            key = os.environ.get(config.key_variable, "")
            if not key:
                raise InvalidValueError(
                    f"The environment variable {config.key_variable} "
                    "(OpenAiServer.key_variable) holds no API key.",
                    remedy=f"Run: export {config.key_variable}=<key>",
                )
            self._headers["Authorization"] = f"Bearer {key}"

    def find(self, image: np.ndarray, label: str) -> Boxes:
        """Returns boxes of equal scores; see `BoxFinder.find`.

        Raises:
            DetectionError: if the server refuses the request, or three attempts in a row fail: it
                cannot be reached, is silent for too long, or its answer is damaged or not as asked.
        """
        height, width = (max(_PATCH, _PATCH * round(n / _PATCH)) for n in image.shape[:2])
        sent = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
        unit = "thousandths of its width and height" if self._config.thousandths else "pixels"
        prompt = _PROMPT.format(label=label, width=width, height=height, unit=unit)
        span = [1000, 1000] if self._config.thousandths else [width, height]
        request = self._request(sent, prompt)
        for attempt in range(_ATTEMPTS):
            try:
                corners = parse_boxes(self._ask(request))
            except _AttemptFailedError as error:
                failure = str(error)
                if attempt < _ATTEMPTS - 1:
                    time.sleep(_BACK_OFF * 2**attempt)
            else:
                scale = np.tile(image.shape[1::-1] / np.array(span), 2)
                return Boxes.in_image(corners * scale, image.shape[:2])
        raise self._failed(failure)

    def _request(self, image: np.ndarray, prompt: str) -> dict[str, Any]:
        _, png = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
        url = f"data:image/png;base64,{base64.b64encode(png.tobytes()).decode()}"
        content = [
            {"type": "image_url", "image_url": {"url": url}},
            {"type": "text", "text": prompt},
        ]
        return {
            "model": self._config.model,
            "messages": [{"role": "user", "content": content}],
            "temperature": 0.0,
            "max_tokens": _MOST_TOKENS,
        }

    def _ask(self, request: dict[str, Any]) -> str:
        """Returns the text of the server's answer."""
        import requests

        try:
            response = requests.post(
                f"{self._config.url.rstrip('/')}/chat/completions",
                json=request,
                headers=self._headers,
                timeout=self._config.timeout,
            )
        except requests.RequestException as error:
            raise _AttemptFailedError(f"{type(error).__name__}: {error}") from error
        if response.status_code == _BUSY or response.status_code >= 500:
            raise _AttemptFailedError(f"status {response.status_code}: {response.text[:200]}")
        if not response.ok:
            raise self._failed(f"status {response.status_code}: {response.text[:200]}")
        try:
            text = response.json()["choices"][0]["message"]["content"]
        except (ValueError, LookupError, TypeError) as error:
            raise _AttemptFailedError(f"no chat completion: {response.text[:200]!r}") from error
        if not isinstance(text, str):
            raise _AttemptFailedError(f"no text, but {text!r}")
        return text

    def _failed(self, reason: str) -> DetectionError:
        return DetectionError(
            f"The server {self._config.url} gave no boxes ({reason}).",
            remedy="Check finder.url, finder.model and the server's output.",
        )


def parse_boxes(text: str) -> np.ndarray:
    """Returns the boxes (n, 4) in a model's answer, in the units of the answer.

    The answer is a JSON list of objects, each with the key `bbox_2d`, or of lists of four numbers.
    It may be in a fenced block, and there may be text around it.

    Raises:
        _AttemptFailedError: if there is no such list.
    """
    decoder, found = json.JSONDecoder(), None
    for start in (match.start() for match in re.finditer(r"\[", text)):
        try:
            items, _ = decoder.raw_decode(text, start)
        except ValueError:
            continue
        boxes = [item.get("bbox_2d") if isinstance(item, dict) else item for item in items]
        if all(_is_box(box) for box in boxes):
            found = np.array(boxes, dtype=float).reshape(-1, 4)
            if len(found):
                break
    if found is None:
        raise _AttemptFailedError(f"no JSON list of boxes: {text[:200]!r}")
    return found


def _is_box(box: object) -> bool:
    return (
        isinstance(box, list)
        and len(box) == 4
        and all(type(value) in (int, float) and abs(value) < 1e6 for value in box)
    )
