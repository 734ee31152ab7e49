"""A local page on which a person draws boxes and clicks on images."""

import asyncio
import base64
import json
import secrets
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from importlib.resources import files
from typing import Any, Protocol, Self

import cv2
import numpy as np
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop
from tornado.netutil import bind_sockets
from tornado.web import Application, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from poil_drake.errors import PoilError
from poil_drake.perception.detectors.by_hand.hand_labels import Mark
from poil_drake.perception.detectors.by_hand.label_file import parse_mark

Masks = Mapping[str, Mapping[str, np.ndarray]]
"""Masks (H, W) bool by role and view."""

_COLORS = ((230, 57, 70), (255, 183, 3), (33, 158, 188), (106, 76, 147))  # RGB, of each role
_OPACITY = 0.45


class MarkStore(Protocol):
    """Where the marks are kept. Each method returns all marks, or raises a PoilError or OSError."""

    def read(self) -> Sequence[Mark]:
        """Returns the marks."""

    def add(self, mark: Mark) -> Sequence[Mark]:
        """Keeps a mark, unless it is there already, before it returns."""

    def undo(self, count: int) -> Sequence[Mark]:
        """Removes the last of `count` marks; nothing if there are more or fewer."""


class MarkPage:
    """Serves the page while it is open as a context manager.

    Only this machine can reach it, at an address with a token that is valid until it is closed. Any
    number of pages may show it at once. The store keeps each mark before a page shows it as saved;
    a page that was reloaded, or cut off for a while, sends its unsaved marks again.

    Attributes:
        url: The page's address.
    """

    def __init__(
        self,
        *,
        title: str,
        images: Mapping[str, np.ndarray],
        roles: Sequence[str],
        store: MarkStore,
        masks: Callable[[Sequence[Mark]], Masks],
    ):
        """Prepares the page.

        Args:
            title: Its title.
            images: Images (H, W, 3) uint8 by the names of their views, shown side by side.
            roles: What can be marked; at most four.
            store: Keeps the marks.
            masks: Returns what marks mean, to be shown; called in another thread.
        """
        self._store, self._masks = store, masks
        self._colors = dict(zip(roles, _COLORS, strict=False))
        config = {
            "title": title,
            "images": {view: _data_url(rgb[..., ::-1]) for view, rgb in images.items()},
            "roles": {role: f"rgb{color}" for role, color in self._colors.items()},
        }
        text = files(__package__).joinpath("mark_page.html").read_text()
        self._html = text.replace("CONFIG", json.dumps(config).replace("</", "<\\/"))
        self._pages: set[_Channel] = set()
        self._latest: Sequence[Mark] = ()
        self._searching = False
        self._done = threading.Event()
        self._ready = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()), daemon=True)
        token = secrets.token_urlsafe(24)
        self._routes: list[Any] = [
            (f"/{token}/", _Page, {"html": self._html}),
            (f"/{token}/channel", _Channel, {"page": self}),
        ]
        self._sockets = bind_sockets(0, "127.0.0.1")
        self.url = f"http://127.0.0.1:{self._sockets[0].getsockname()[1]}/{token}/"

    def __enter__(self) -> Self:
        self._thread.start()
        self._ready.wait()
        return self

    def __exit__(self, *exception: object) -> None:
        self._loop.call_soon_threadsafe(self._closing.set)
        self._thread.join()

    def wait(self) -> None:
        """Waits until the person has pressed "Done"."""
        self._done.wait()

    async def _serve(self) -> None:
        self._loop, self._closing = asyncio.get_running_loop(), asyncio.Event()
        server = HTTPServer(Application(self._routes))
        server.add_sockets(self._sockets)
        self._ready.set()
        await self._closing.wait()
        server.stop()
        for page in tuple(self._pages):
            page.close()
        await server.close_all_connections()

    def join(self, page: "_Channel") -> None:
        """Adds an open page, and shows it the marks."""
        self._pages.add(page)
        self._reply(page, self._store.read)

    def leave(self, page: "_Channel") -> None:
        """Forgets a page that was closed."""
        self._pages.discard(page)

    def receive(self, page: "_Channel", message: Mapping[str, Any]) -> None:
        """Does what a page asks for: {"add": mark}, {"undo": number of marks} or {"done": true}."""
        if "add" in message:
            self._reply(page, lambda: self._store.add(parse_mark(message["add"])))
        elif "undo" in message:
            self._reply(page, lambda: self._store.undo(message["undo"]))
        elif "done" in message:
            self._done.set()

    def _reply(self, page: "_Channel", action: Callable[[], Sequence[Mark]]) -> None:
        """Shows the marks after an action to all pages; shows an error to the page that asked."""
        try:
            self._latest = action()
        except (PoilError, OSError) as error:
            page.tell({"error": str(error)})
            return
        self._send({"marks": [asdict(mark) for mark in self._latest]})
        if not self._searching:
            self._searching = True
            IOLoop.current().add_callback(self._show_masks)

    async def _show_masks(self) -> None:
        marks: Sequence[Mark] | None = None
        try:
            while marks is not self._latest:
                marks = self._latest
                found = await asyncio.to_thread(self._masks, marks)
            shown = {
                role: {view: _data_url(self._tinted(mask, role)) for view, mask in views.items()}
                for role, views in found.items()
            }
            self._send({"masks": shown})
        finally:
            self._searching = False

    def _tinted(self, mask: np.ndarray, role: str) -> np.ndarray:
        """Returns a mask as an image (H, W, 4) uint8 in the role's colour, BGRA."""
        return mask[..., None] * np.array([*self._colors[role][::-1], 255 * _OPACITY], np.uint8)

    def _send(self, message: Mapping[str, Any]) -> None:
        for page in tuple(self._pages):
            page.tell(message)


class _Page(RequestHandler):
    """Sends the page."""

    def initialize(self, html: str) -> None:
        self._html = html

    def get(self) -> None:
        self.set_header("Cache-Control", "no-store")
        self.finish(self._html)


class _Channel(WebSocketHandler):
    """Connects an open page."""

    def initialize(self, page: MarkPage) -> None:
        self._page = page

    def tell(self, message: Mapping[str, Any]) -> None:
        """Sends a message, which a page that has just been closed does not need."""
        with suppress(WebSocketClosedError):
            sent = self.write_message(dict(message))
            sent.add_done_callback(lambda future: future.cancelled() or future.exception())

    def open(self, *args: str, **kwargs: str) -> None:
        self._page.join(self)

    def on_message(self, message: str | bytes) -> None:
        self._page.receive(self, json.loads(message))

    def on_close(self) -> None:
        self._page.leave(self)


def _data_url(image: np.ndarray) -> str:
    """Returns an image (H, W, 3 or 4) uint8, BGR or BGRA, as a PNG in a `data:` address."""
    png = cv2.imencode(".png", image)[1].tobytes()
    return f"data:image/png;base64,{base64.b64encode(png).decode()}"
