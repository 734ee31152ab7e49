"""What a viewer sees of the page that shows a plan."""

from pathlib import Path

import pytest

pytestmark = [pytest.mark.browser, pytest.mark.render]


@pytest.fixture
def plan_page(page, plan_file: Path):
    page.open_once(plan_file.with_suffix(".html"))
    assert page.title == "Plan: mug, handle"
    return page


def test_robot_object_reference_and_grasps_are_seen(plan_page):
    seen = plan_page.appearances(
        f"/meshcat/{path}" for path in ("robot", "object/cloud", "obstacles", "reference", "grasps")
    )

    assert seen["/meshcat/robot"].pixels > 5000
    assert all(appearance.pixels > 50 for appearance in seen.values())
    assert seen["/meshcat/object/cloud"].share_of_hue((0.91, 0.64, 0.24)) > 0.5
    assert seen["/meshcat/reference"].share_of_hue((0.48, 0.18, 0.75)) > 0.5
    assert not plan_page.errors()


def test_the_slider_carries_the_object_to_the_fixture(plan_page):
    before = plan_page.appearance("/meshcat/object").centre
    fixture = plan_page.appearance("/meshcat/obstacles").centre

    plan_page.seek(plan_page.duration)

    after = plan_page.appearance("/meshcat/object").centre
    assert abs(after - fixture).sum() < 0.5 * abs(before - fixture).sum()
