import numpy as np

from poil_drake.perception.detectors.by_hand.support_plane import off_support

CENTRE = np.array([0.4, 0.1, 0.02])


def points_at_heights(*heights: float) -> np.ndarray:
    """Returns 3000 points within 0.2 m of the centre for each height, with noise of 1 mm."""
    draw = np.random.default_rng(1)
    xy = draw.uniform(-0.15, 0.15, (len(heights), 3000, 2)) + CENTRE[:2]
    z = np.repeat(np.array(heights)[:, None], 3000, axis=1)
    z += np.clip(draw.normal(0.0, 0.001, z.shape), -0.0025, 0.0025)
    return np.concatenate([xy, z[..., None]], axis=2).reshape(-1, 3)


def test_what_stands_on_a_table_is_above_it() -> None:
    points = points_at_heights(0.2, 0.2, 0.22)

    above = off_support(points, around=CENTRE, among=np.ones(len(points), bool))

    # The noise reaches 2.5 standard deviations, less than the 3 that belong to the table.
    np.testing.assert_array_equal(above, np.arange(9000) >= 6000)


def test_a_low_plate_does_not_tilt_or_lift_the_table() -> None:
    """Planes between the table and a plate of 12 mm have both within 8 mm."""
    points = points_at_heights(0.0, 0.0, 0.012)

    above = off_support(points, around=CENTRE, among=np.ones(len(points), bool))

    np.testing.assert_array_equal(above, np.arange(9000) >= 6000)


def test_a_wall_supports_nothing() -> None:
    points = points_at_heights(0.0)[:, [0, 2, 1]]

    assert off_support(points, around=points[0], among=np.ones(len(points), bool)) is None


def test_only_the_surroundings_show_the_plane() -> None:
    points = points_at_heights(0.0)

    assert off_support(points, around=CENTRE, among=np.zeros(len(points), bool)) is None
