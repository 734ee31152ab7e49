"""`poil label` as a person uses it: boxes and clicks on the page, and the file beside the scene."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import urlopen

import numpy as np
import pytest
from block_scene import HEIGHT, WIDTH, make_scene
from conftest import PATIENCE

from poil_drake.perception.detectors.by_hand.detector import HandLabelDetector, hand_label_masks
from poil_drake.perception.detectors.by_hand.hand_labels import (
    BOX,
    EXCLUDE,
    INCLUDE,
    ROLES,
    HandLabels,
    Mark,
    labels_path,
)
from poil_drake.perception.detectors.by_hand.label_file import LabelFile
from poil_drake.recording.demonstration.demonstration import load_demonstration
from poil_drake.recording.demonstration.writer import DemonstrationWriter
from poil_drake.reports.mark_page import MarkPage

pytest.importorskip("selenium", reason="selenium is not installed")
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.actions.wheel_input import ScrollOrigin
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.wait import WebDriverWait

pytestmark = pytest.mark.browser

SCENE = make_scene()


class LabelPage:
    """The page in one window of the browser."""

    def __init__(self, driver, url: str):
        self._chromium = driver
        driver.get(url)
        self._window = driver.current_window_handle
        self.wait_for_masks(None)

    @property
    def _driver(self):
        self._chromium.switch_to.window(self._window)
        return self._chromium

    def run(self, script: str):
        """Runs JavaScript in the page."""
        return self._driver.execute_script(script)

    def wait(self, condition: str) -> None:
        """Waits until a JavaScript expression is true."""
        wait = WebDriverWait(self._driver, PATIENCE, poll_frequency=0.02)
        wait.until(lambda driver: driver.execute_script(f"return {condition};"))

    def wait_for_masks(self, count: int | None) -> None:
        """Waits until the page shows the masks of `count` marks; None: of any number."""
        masks = "document.body.dataset.masks"
        self.wait(f"{masks} === '{count}'" if count is not None else f"!!{masks}")

    def press(self, key: str) -> None:
        self._driver.find_element("tag name", "body").send_keys(key)

    def push(self, button: str) -> None:
        self._driver.find_element("id", button).click()

    def click(self, view: str, at, *, key: str | None = None) -> None:
        """Clicks on a pixel, with a key held down."""
        actions = self._actions().move_to_element_with_offset(*self._place(view, at))
        if key is None:
            actions.click()
        else:
            actions.key_down(key).click().key_up(key)
        actions.perform()

    def drag(self, view: str, box) -> None:
        """Draws a box (left, top, right, bottom) [px]."""
        start, end = self._place(view, box[:2]), self._place(view, box[2:])
        actions = self._actions().move_to_element_with_offset(*start).click_and_hold()
        actions.move_to_element_with_offset(*end).release().perform()

    def scroll(self, view: str, at, amount: int) -> None:
        """Turns the wheel over a pixel."""
        element, x, y = self._place(view, at)
        origin = ScrollOrigin.from_element(element, x, y)
        self._actions().scroll_from_origin(origin, 0, amount).perform()

    def pixel(self, view: str, at) -> np.ndarray:
        """Returns the colour (3,) that the page shows at a pixel of a view."""
        canvas, x, y = self._place(view, at)
        script = """const c = arguments[0], d = window.devicePixelRatio;
            return Array.from(c.getContext('2d').getImageData(
                d * (arguments[1] + c.clientWidth / 2), d * (arguments[2] + c.clientHeight / 2),
                1, 1).data);"""
        return np.array(self._driver.execute_script(script, canvas, x, y)[:3], dtype=int)

    def _actions(self):
        return ActionChains(self._driver, duration=0)

    def _place(self, view: str, at):
        """Returns the view's element, and a pixel's offset from the element's middle."""
        canvas = self._driver.find_element("id", f"view-{view}")
        size = canvas.size
        x, y = ((at[i] + 0.5) / n for i, n in enumerate((WIDTH, HEIGHT)))
        return canvas, round((x - 0.5) * size["width"]), round((y - 0.5) * size["height"])


@pytest.fixture
def demo(tmp_path: Path) -> Path:
    path = tmp_path / "demo.mcap"
    with DemonstrationWriter(path, ["left", "right"], {}) as writer:
        for stamp in (0.0, 0.125):
            writer.write(make_scene(stamp=stamp).frame)
    return path


@pytest.fixture
def process(demo: Path) -> Iterator[subprocess.Popen]:
    """A process that runs `poil label`."""
    command = [sys.executable, "-m", "poil_drake", "label", demo]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    yield process
    process.kill()
    process.wait()
    process.stdout.close()


@pytest.fixture
def served(demo: Path) -> Iterator[str]:
    """The address of a page that a thread of this process serves."""
    frame = load_demonstration(demo).frames[0]
    with MarkPage(
        title="blocks",
        images={c.name: i.rgb for c, i in zip(frame.cameras, frame.images, strict=True)},
        roles=ROLES,
        store=LabelFile(labels_path(demo), frame),
        masks=lambda marks: hand_label_masks(frame, HandLabels.of(frame).with_marks(marks)),
    ) as page:
        yield page.url


def address(process: subprocess.Popen) -> str:
    """Returns the address that `poil label` prints."""
    return process.stdout.readline().removeprefix("open ").strip()


@pytest.fixture
def open_page(chromium) -> Iterator[Callable[[str], LabelPage]]:
    """Opens pages, each in its own window, and closes them at the end."""
    first = chromium.current_window_handle
    chromium.get_log("browser")

    def open_page(url: str) -> LabelPage:
        chromium.switch_to.new_window("window")
        chromium.set_window_size(1000, 700)
        return LabelPage(chromium, url)

    yield open_page
    for window in chromium.window_handles:
        if window != first:
            chromium.switch_to.window(window)
            chromium.close()
    chromium.switch_to.window(first)


def marks(demo: Path) -> list[tuple[str, str, str]]:
    """Returns view, role and kind of the marks in the file."""
    return [(m.view, m.role, m.kind) for m in HandLabels.load(labels_path(demo)).marks]


def test_a_person_marks_a_scene_and_the_detector_finds_it(
    open_page, demo, process, chromium
) -> None:
    dut = open_page(address(process))
    middle = SCENE.middle("right", "object")
    before = dut.pixel("right", middle)

    dut.drag("left", SCENE.box("left", "object", "handle"))
    dut.wait_for_masks(1)
    masked = dut.pixel("right", middle)
    dut.press("m")
    hidden = dut.pixel("right", middle)
    dut.press("2")
    dut.drag("left", SCENE.box("left", "handle"))
    dut.click("left", SCENE.middle("left", "object"), key=Keys.SHIFT)
    dut.wait("marks.length === 3")
    dut.press("z")
    dut.wait("marks.length === 2")
    dut.push("role-fixture")
    # What is below the mouse stays there.
    dut.scroll("right", SCENE.middle("right", "post"), -500)
    dut.click("right", SCENE.middle("right", "post"))
    dut.wait_for_masks(3)
    errors = [entry for entry in chromium.get_log("browser") if entry["level"] == "SEVERE"]
    dut.push("done")

    path = demo.with_suffix(".labels.json")
    assert process.wait() == 0
    assert process.stdout.read() == f"3 marks are in {path}\n"
    assert errors == []
    expected = [("left", "object", BOX), ("left", "part", BOX), ("right", "fixture", INCLUDE)]
    assert marks(demo) == expected
    at = HandLabels.load(path).marks[2].at
    np.testing.assert_allclose(at, SCENE.middle("right", "post"), atol=1.0)
    # The box in one view shows a mask in the other, too.
    assert np.abs(masked - before).max() > 10
    np.testing.assert_array_equal(hidden, before)
    frame = load_demonstration(demo).frames[0]
    found = HandLabelDetector([path]).detect(frame, object_label="mug", part_label="handle")
    assert found.object_masks[1][round(middle[1]), round(middle[0])]


def test_two_pages_show_each_others_marks_and_a_reload_keeps_them(open_page, demo, served) -> None:
    one, other = open_page(served), open_page(served)

    other.click("left", SCENE.middle("left", "object"))
    one.click("right", SCENE.middle("right", "post"))

    for page in (one, other):
        page.wait("marks.length === 2")
    other.run("location.reload();")
    other.wait_for_masks(2)
    assert marks(demo) == [("left", "object", INCLUDE), ("right", "object", INCLUDE)]


def test_a_click_whose_message_was_lost_is_sent_again_after_a_reload(
    open_page, demo, served
) -> None:
    dut = open_page(served)
    dut.run("channel.send = () => {};")

    dut.click("left", SCENE.middle("left", "object"))
    dut.run("location.reload();")
    dut.wait_for_masks(1)

    assert marks(demo) == [("left", "object", INCLUDE)]


def test_the_page_says_why_a_mark_cannot_be_saved(open_page, demo, served) -> None:
    dut = open_page(served)
    labels_path(demo).write_text("{}")

    dut.click("left", SCENE.middle("left", "object"))

    dut.wait("document.getElementById('problem').textContent.includes('is damaged')")


def test_a_killed_server_loses_no_saved_mark_and_the_page_says_so(open_page, demo, process) -> None:
    dut = open_page(address(process))
    dut.drag("left", SCENE.box("left", "object", "handle"))
    dut.wait("marks.length === 1")

    process.kill()
    dut.wait("document.getElementById('problem').textContent.includes('server has ended')")
    dut.click("left", SCENE.middle("left", "object"))

    assert dut.run("return [marks.length, pending.length];") == [1, 1]
    assert marks(demo) == [("left", "object", BOX)]


def test_marks_of_an_earlier_server_are_continued(open_page, demo, served) -> None:
    frame = load_demonstration(demo).frames[0]
    earlier = Mark(view="left", role="object", kind=INCLUDE, at=SCENE.middle("left", "object"))
    LabelFile(labels_path(demo), frame).add(earlier)

    dut = open_page(served)
    dut.click("left", SCENE.middle("left", "post"), key=Keys.SHIFT)
    dut.wait_for_masks(2)

    assert marks(demo) == [("left", "object", INCLUDE), ("left", "object", EXCLUDE)]


def test_an_address_without_the_token_shows_nothing(served: str) -> None:
    host = served.split("/")[2]

    with pytest.raises(HTTPError, match="404"):
        urlopen(f"http://{host}/")
