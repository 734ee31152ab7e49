"""A worker for the tests: it echoes requests, or fails on demand."""

import os
import time
from typing import Any

from poil_drake.errors import InvalidValueError, TrackingError
from poil_drake.runtime.worker_process import serve


class Echo:
    """Answers with its setup, its process ID, and the word and arrays of the request."""

    def __init__(self, setup: Any):
        if setup == "refused":
            raise InvalidValueError("There is no such setup.", remedy="Ask for another.")
        if setup == "broken":
            raise ZeroDivisionError("in the beginning")
        self._setup = setup

    def __call__(self, request: tuple[str, list[Any]]) -> tuple[Any, int, str, list[Any]]:
        word, arrays = request
        if word == "fail":
            raise TrackingError("Nothing is seen.", remedy="Look again.")
        if word == "stumble":
            raise ZeroDivisionError("by mistake")
        if word == "leave a child" and os.fork() == 0:
            time.sleep(10.0)
            os._exit(0)
        if word in ("die", "leave a child"):
            os._exit(7)
        return self._setup, os.getpid(), word, arrays


if __name__ == "__main__":
    serve(Echo)
