import numpy as np
import pytest
from box_scene import BLOCK, BODY, CUP, HANDLE, known_shape, picture, placed, pose, surface

from poil_drake.geometry.point_cloud import PointCloud
from poil_drake.geometry.rigid_transform import rotation_exp
from poil_drake.perception.detectors.known_shape.shape_fit import KnownShape, Placements, ShapeFit

SHAPE = known_shape(BODY, HANDLE)


@pytest.fixture(scope="module")
def fit() -> ShapeFit:
    """The fit to a cup that is as and where the shape is."""
    frame = picture({"cup": CUP}).frame
    return ShapeFit(SHAPE, frame, SHAPE.cloud, table_height=0.0, count=400)


def at(*, shift: tuple[float, float, float] = (0, 0, 0), yaw: float = 0.0, size: float = 1.0):
    R = rotation_exp(np.array([[0.0, 0.0, np.deg2rad(yaw)]]))
    return Placements(R, np.full((1, 3), np.log(size)), SHAPE.center[None] + shift)


def test_a_shape_at_rest_is_where_it_was() -> None:
    moved = Placements.at_rest(SHAPE).apply(SHAPE, SHAPE.cloud.points)

    np.testing.assert_allclose(moved[0], SHAPE.cloud.points, atol=1e-12)


def test_a_shape_is_stretched_along_its_axes_then_turned_then_moved() -> None:
    # A flat bar, whose axes are those of the frame: it is shortest along z and longest along x.
    bar = PointCloud(np.array([[2.0, 0, 0], [-2, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 0.1]]))
    shape = KnownShape(bar, np.ones(5, dtype=bool), np.zeros(5, dtype=bool))
    quarter = rotation_exp(np.array([[0.0, 0.0, np.pi / 2.0]]))
    # `eigh` sorts the axes by length.
    stretched = Placements(quarter, np.log([[1.0, 1.0, 3.0]]), np.array([[10.0, 20.0, 30.0]]))

    (moved,) = stretched.apply(shape, shape.center + np.diag([2.0, 1.0, 0.0])[:2])

    np.testing.assert_allclose(moved, [[10.0, 26.0, 30.0], [9.0, 20.0, 30.0]], atol=1e-9)


def test_placements_are_joined_and_selected() -> None:
    both = at(yaw=10.0).joined(at(yaw=20.0))

    np.testing.assert_array_equal(both.select(np.array([1])).R, at(yaw=20.0).R)
    assert len(both) == 2


def test_the_right_place_costs_next_to_nothing(fit: ShapeFit) -> None:
    assert fit.cost(at())[0] < 0.02


@pytest.mark.parametrize(
    "wrong",
    [
        at(shift=(0.02, 0.0, 0.0)),
        at(shift=(0.0, 0.0, -0.02)),
        at(yaw=30.0),
        at(yaw=180.0),
        at(size=1.3),
        at(size=0.7),
    ],
    ids=["beside", "in the table", "turned", "turned around", "larger", "smaller"],
)
def test_other_places_cost_more(fit: ShapeFit, wrong: Placements) -> None:
    assert fit.cost(wrong)[0] > fit.cost(at())[0] + 0.02


def test_costs_are_the_squares_of_the_residuals(fit: ShapeFit) -> None:
    some = at().joined(at(yaw=50.0))

    np.testing.assert_allclose((fit.residuals(some) ** 2).sum(axis=1), fit.cost(some))


def test_points_on_the_surface_are_seen_and_points_before_it_are_seen_through(
    fit: ShapeFit,
) -> None:
    before = fit.support(SHAPE.cloud.points[SHAPE.part] + [0.05, 0.0, 0.05])

    assert fit.support(SHAPE.cloud.points[SHAPE.part]) == (1.0, 0.0)
    assert before == (0.0, 1.0)


def test_points_behind_an_object_are_neither() -> None:
    # The block hides a point 2 cm behind it from the one camera, to which its corner points.
    block = placed(BLOCK, pose(0.0, 0.0))
    seen = picture({"block": block})
    dut = ShapeFit(SHAPE, seen.frame, surface(block), table_height=0.0, count=50)

    assert dut.support(np.array([[-0.06, 0.0, 0.01]])) == (0.0, 0.0)


def test_what_is_below_the_table_is_free(fit: ShapeFit) -> None:
    assert fit.support(np.array([[0.0, 0.0, -0.03]])) == (0.0, 1.0)
