"""Meshcat pages in headless Chromium: what a viewer sees, as pixels.

The appearance of an object is the difference between two screenshots, with it and without it. So no
other object of the same colour can satisfy a test.
"""

import colorsys
import shutil
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

WINDOW = (900, 700)  # [px] Small, because every pixel is drawn in software.
PATIENCE = 1800.0  # [s] before a page counts as broken; only a failing test waits that long.
BACKGROUND_NOISE = 12  # Largest change of a colour channel that counts as noise.
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--hide-scrollbars",
    "--force-device-scale-factor=1",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-extensions",
)


_NODE = """let node = viewer.scene_tree;
    for (const name of arguments[0]) { node = node && node.children[name]; }
    """


@dataclass(frozen=True)
class Appearance:
    """The pixels that an object changes.

    Attributes:
        mask: (H, W) their mask in the screenshot.
        colors: (P, 3) their colours with the object, RGB in [0, 1].
    """

    mask: np.ndarray
    colors: np.ndarray

    @property
    def pixels(self) -> int:
        """Number of pixels."""
        return len(self.colors)

    @property
    def color(self) -> np.ndarray:
        """(3,) their median colour, RGB in [0, 1]."""
        return np.median(self.colors, axis=0)

    @property
    def centre(self) -> np.ndarray:
        """(2,) their mean position, right and down [px]."""
        rows, columns = np.nonzero(self.mask)
        return np.array([columns.mean(), rows.mean()])

    @property
    def size(self) -> np.ndarray:
        """(2,) width and height of their bounding box [px]."""
        rows, columns = np.nonzero(self.mask)
        return np.array([np.ptp(columns) + 1, np.ptp(rows) + 1])

    def share_of_hue(self, color: tuple[float, ...], tolerance: float = 25.0) -> float:
        """Returns the share of the pixels with the hue of `color`, within a tolerance [deg]."""
        wanted = colorsys.rgb_to_hsv(*color[:3])[0]
        hsv = np.array([colorsys.rgb_to_hsv(*rgb) for rgb in self.colors]).reshape(-1, 3)
        distance = np.abs((hsv[:, 0] - wanted + 0.5) % 1.0 - 0.5) * 360.0
        return float(np.mean((distance <= tolerance) & (hsv[:, 1] > 0.25))) if len(hsv) else 0.0


class MeshcatPage:
    """A Meshcat page, live or a recording, as its viewer sees it."""

    def __init__(self, driver):
        self._driver = driver
        self._address: str | Path | None = None

    def open_once(self, address: str | Path) -> None:
        """Opens an address or a file unless it is open already."""
        if self._address != address:
            self.open(address)

    def open(self, address: str | Path) -> None:
        """Opens an address or a file, and waits until it shows a scene at rest."""
        url = address.resolve().as_uri() if isinstance(address, Path) else address
        self._driver.get(url)
        self._wait_for("return typeof viewer !== 'undefined' && !!viewer.scene_tree;")
        # A recording starts playing; only when paused does the page stop changing.
        self._driver.execute_script("viewer.animator.pause();")
        self._address = address
        self.settle()

    def wait_for_objects(self, paths: Iterable[str]) -> None:
        """Waits until objects exist at Meshcat paths; a live page receives them one by one."""
        for path in paths:
            self._wait_for(_NODE + "return !!node;", _names(path))
        self.settle()

    def leave(self) -> None:
        """Opens an empty page, because a page keeps drawing, and keeps calling its server."""
        self._driver.get("about:blank")
        self._address = None

    def pause(self) -> None:
        """Stops playback."""
        self._wait_for("return viewer.animator.actions.length > 0;")
        self._driver.execute_script("viewer.animator.pause();")

    def seek(self, seconds: float) -> None:
        """Shows the recording at a time."""
        self.pause()
        self._driver.execute_script("viewer.animator.seek(arguments[0]);", seconds)
        self._render()

    @property
    def duration(self) -> float:
        """The length of the recording [s]."""
        self.pause()
        return self._driver.execute_script("return viewer.animator.duration;")

    @property
    def title(self) -> str:
        """The page's title."""
        return self._driver.title

    def set_visible(self, path: str, visible: bool) -> None:
        """Shows or hides the objects below a Meshcat path, in this page only."""
        script = "viewer.set_property(arguments[0], 'visible', arguments[1]);"
        self._driver.execute_script(script, _names(path), visible)

    def is_visible(self, path: str) -> bool:
        """Returns whether a Meshcat path and all its parents are visible."""
        script = """let node = viewer.scene_tree, visible = true;
            for (const name of arguments[0]) {
                node = node.children[name]; visible = visible && node.object.visible; }
            return visible;"""
        return self._driver.execute_script(script, _names(path))

    def move_viewer(self, position: list[float]) -> None:
        """Moves the camera to a position in the world [m]; its target stays the same."""
        x, y, z = position
        # The page's camera lives in a frame with y up.
        names = ["Cameras", "default", "rotated", "<object>"]
        script = "viewer.set_property(arguments[0], 'position', arguments[1]);"
        self._driver.execute_script(script, names, [x, z, -y])
        self._driver.execute_script("viewer.controls.update();")

    def press(self, key: str) -> None:
        """Presses a key while the page has the focus."""
        self._driver.find_element("tag name", "body").send_keys(key)

    def screenshot(self) -> np.ndarray:
        """Returns a screenshot, (H, W, 3) uint8 RGB."""
        self._render()
        png = np.frombuffer(self._driver.get_screenshot_as_png(), np.uint8)
        return cv2.cvtColor(cv2.imdecode(png, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)

    def appearance(self, path: str) -> Appearance:
        """Returns the pixels that the objects below a path change, by hiding them briefly."""
        return self.appearances([path])[path]

    def appearances(self, paths: Iterable[str]) -> dict[str, Appearance]:
        """Returns the pixels that the objects below each of several paths change."""
        with_it = self.screenshot()
        found = {}
        for path in paths:
            shown = self._driver.execute_script(_NODE + "return node.object.visible;", _names(path))
            self.set_visible(path, False)
            change = np.abs(with_it.astype(int) - self.screenshot().astype(int)).max(axis=2)
            self.set_visible(path, shown)
            mask = change > BACKGROUND_NOISE
            found[path] = Appearance(mask, with_it[mask] / 255.0)
        return found

    def errors(self) -> list[str]:
        """Returns the errors of the page since the last call."""
        entries = self._driver.get_log("browser")
        return [entry["message"] for entry in entries if entry["level"] == "SEVERE"]

    def settle(self) -> None:
        """Waits until two screenshots are equal, because models are loaded in the background."""
        deadline = time.monotonic() + PATIENCE
        last = self.screenshot()
        while time.monotonic() < deadline:
            now = self.screenshot()
            if np.array_equal(now, last):
                return
            last = now
        pytest.fail("The page keeps changing.")

    def _render(self) -> None:
        self._driver.execute_async_script(
            """const done = arguments[arguments.length - 1];
            requestAnimationFrame(() => { viewer.render(); requestAnimationFrame(done); });"""
        )

    def _wait_for(self, script: str, *arguments: object) -> None:
        deadline = time.monotonic() + PATIENCE
        while not self._driver.execute_script(script, *arguments):
            if time.monotonic() > deadline:
                pytest.fail(f"Waited {PATIENCE} s without success for: {script}")


def _names(path: str) -> list[str]:
    """Returns the names in a path. As in Drake, a path without a leading / is below /drake."""
    absolute = path if path.startswith("/") else f"/drake/{path}"
    return [name for name in absolute.split("/") if name]


@pytest.fixture(scope="session")
def chromium(tmp_path_factory):
    """A headless Chromium with WebGL in software; skips the test if there is none."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is not installed")
    names = ("chromium", "chromium-browser", "google-chrome")
    binary = next((found for name in names if (found := shutil.which(name))), None)
    chromedriver = shutil.which("chromedriver")
    if binary is None or chromedriver is None:
        pytest.skip("chromium and chromedriver are not installed (apt install chromium-driver)")
    options = webdriver.ChromeOptions()
    options.binary_location = binary
    for flag in FLAGS:
        options.add_argument(flag)
    options.add_argument("--window-size={},{}".format(*WINDOW))
    options.add_argument(f"--user-data-dir={tmp_path_factory.mktemp('chromium')}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(chromedriver))
    driver.command_executor.client_config.timeout = PATIENCE
    driver.set_page_load_timeout(PATIENCE)
    driver.set_script_timeout(PATIENCE)
    yield driver
    driver.quit()


@pytest.fixture(scope="module")
def page(chromium):
    """A page to open addresses in. Tests share it, and restore what they change."""
    assert chromium.execute_script(
        "return !!document.createElement('canvas').getContext('webgl2');"
    ), "This Chromium has no WebGL."
    page = MeshcatPage(chromium)
    page.errors()  # Discard those of earlier pages.
    yield page
    page.leave()
