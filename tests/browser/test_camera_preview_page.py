"""What a person sees who records a demonstration, and the key that starts it."""

import numpy as np
import pytest

from poil_drake.diagrams.demonstration.camera_recorder import BUTTON, BUTTON_KEY
from poil_drake.diagrams.run.html_recording import MakeMeshcat
from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.systems.visualization.camera_preview import CameraPreview
from poil_drake.systems.visualization.meshcat_overlay import OVERLAY_PATH

pytestmark = pytest.mark.browser

RED = (0.9, 0.1, 0.1)
K = np.array([[120.0, 0.0, 79.5], [0.0, 120.0, 59.5], [0.0, 0.0, 1.0]])


def test_the_page_shows_the_cloud_the_camera_and_the_state_and_space_presses_the_button(page):
    X_WC = np.diag([1.0, -1.0, -1.0, 1.0])  # Looks straight down.
    X_WC[:3, 3] = [0.3, 0.06, 0.6]
    camera = CameraModel("left", 160, 120, K, X_WC)
    meshcat = MakeMeshcat()
    meshcat.AddButton(BUTTON, BUTTON_KEY)
    dut = CameraPreview(meshcat, [camera], texts=["ready", "recording"])
    rgb = np.full((120, 160, 3), np.round(255 * np.array(RED)), np.uint8)
    dut.show_images({"left": RgbdImage(rgb, np.full((120, 160), 0.4, np.float32), 0.0)})
    dut.show_text("ready")

    page.open(meshcat.web_url())
    page.wait_for_objects(["cameras/left/cloud", "cameras/left/pyramid"])

    seen = page.appearances(["cameras/left/cloud", "cameras/left/pyramid"])
    # The cloud covers 0.53 m x 0.4 m, seen from 1.3 m away under 30 degrees.
    assert seen["cameras/left/cloud"].pixels > 10_000
    assert seen["cameras/left/cloud"].share_of_hue(RED) > 0.9
    assert seen["cameras/left/pyramid"].pixels > 100
    assert page.is_visible(f"{OVERLAY_PATH}/phase/name/0")
    assert meshcat.GetButtonClicks(BUTTON) == 0
    page.press(" ")
    while meshcat.GetButtonClicks(BUTTON) == 0:
        page.screenshot()
    assert page.errors() == []
