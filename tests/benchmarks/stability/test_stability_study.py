import json

import numpy as np
import pytest
from matplotlib.image import imread

from poil_drake.benchmarks.stability.measures import delayed_flow, delayed_offsets
from poil_drake.benchmarks.stability.stability import run_stability_study
from poil_drake.control.theory.stability import rotation_potential, rotation_velocity
from poil_drake.geometry.rigid_transform import rotation_exp


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    pictures, json_path = folder / "pictures", folder / "figures.json"
    return folder, run_stability_study(pictures=pictures, json_path=json_path)


def test_pictures_and_figures_are_written(study):
    folder, figures = study
    written = json.loads((folder / "figures.json").read_text())

    assert written.keys() == figures.keys() == {"escape", "sampling", "delay", "noise"}
    for name in written:
        picture = imread(folder / "pictures" / f"control_{name}.png")[..., :3]
        # Axes and text are grey; curves and areas have colours.
        assert np.mean(np.ptp(picture, axis=2) > 0.1) > 0.003


def test_saddles_are_left_at_their_rates(study):
    ways = study[1]["escape"]["ways"]

    # W = 1 : 2 : 3: all three ways out of the first, two of the second, one of the third.
    assert [(way["saddle"], way["axis"]) for way in ways] == [
        (1, 1), (1, 2), (1, 3), (2, 1), (2, 2), (3, 3)
    ]  # fmt: skip
    rates = [1.0, 1 / 2, 1 / 3, 1 / 5, 1.0, 1.0]
    np.testing.assert_allclose([way["slope"] for way in ways], 1.0 / np.array(rates), rtol=2e-3)


def test_twists_of_compact_points_may_be_held_longer(study):
    sets = study[1]["sampling"]["sets"]

    assert sets["compact"]["largest"] == pytest.approx(2.0, abs=1e-6)
    assert np.pi / 2 < sets["elongated"]["largest"] < 1.8
    for data in sets.values():
        assert data["proven"] < data["largest"] <= np.min(data["limits"]) + 1e-9


def test_map_of_delay_and_period_is_divided_by_the_limits(study):
    def verdict(delay, period):
        verdicts = study[1]["delay"]["verdicts"]
        # 44 cells up to a delay of 1.8 and a period of 2.2.
        return verdicts[int(44 * period / 2.2), int(44 * delay / 1.8)]

    assert verdict(0.1, 0.1) == 0
    assert verdict(0.9, 0.1) == 1
    assert verdict(1.7, 0.1) == 2
    assert verdict(0.5, 1.6) == 1
    assert verdict(1.3, 1.6) == 2


def test_tracker_of_the_paper_overshoots_by_a_quarter(study):
    tracker = study[1]["delay"]["tracker"]
    expected = [1.0, 1.0, 1.0]
    for _ in range(60):
        expected.append(expected[-1] - 0.1875 * (expected[-2] + expected[-3]))

    np.testing.assert_allclose(tracker["offsets"], expected[2:], atol=1e-12)
    assert np.min(tracker["offsets"]) == pytest.approx(-0.255, abs=1e-3)


def test_noise_is_amplified_as_predicted_where_it_is_small(study):
    noise = study[1]["noise"]

    # 30 mm from the line with 1 mm of noise; a deviation from 200 draws is known to 5 %.
    assert noise["measured"][-1] == pytest.approx(noise["predicted"][-1], rel=0.25)
    assert noise["limited"][0] < 0.8 * noise["measured"][0]


def test_flow_without_delay_is_the_held_flow():
    W, R = np.diag([1.0, 2.0, 3.0]), rotation_exp(np.array([0.5, -1.0, 0.7]))

    potentials = delayed_flow(W, R, np.zeros(1), np.array([0.4]), count=10)[:, 0]

    for potential in potentials:
        assert potential == pytest.approx(rotation_potential(W, R), abs=1e-9)
        R = R @ rotation_exp(0.4 * rotation_velocity(W, R))


def test_offsets_with_a_whole_delay_follow_their_recurrence():
    # e_{n+1} = e_n - e_{n-1} / 5, at rest before.
    np.testing.assert_allclose(delayed_offsets(0.2, 1.0, 4), [1.0, 0.8, 0.6, 0.44, 0.32])
