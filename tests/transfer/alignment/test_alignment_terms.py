"""The energies and their gradients, the latter against finite differences."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from poil_drake.geometry.point_cloud import PointCloud
from poil_drake.transfer.alignment.cloud_term import (
    CONTEXT_CLOUD,
    PART_CLOUD,
    CloudTerm,
    nearest_both_ways,
)
from poil_drake.transfer.alignment.join_term import JoinTerm
from poil_drake.transfer.alignment.state import UNKNOWNS, AlignmentState, NormalEquations

Maker = Callable[..., PointCloud]


def some_state() -> AlignmentState:
    rng = np.random.default_rng(1)
    return AlignmentState(
        R=Rotation.from_rotvec(0.1 * rng.normal(size=(2, 3))).as_matrix(),
        log_scales=0.1 * rng.normal(size=(2, 2, 3)),
        translations=0.05 * rng.normal(size=(2, 2, 3)),
    )


def numerical_gradient(
    energy: Callable[[AlignmentState], np.ndarray], state: AlignmentState
) -> np.ndarray:
    columns = []
    for u in range(UNKNOWNS):
        step = np.zeros((len(state), UNKNOWNS))
        step[:, u] = 1e-6
        ahead, behind = (energy(state.moved(s)) for s in (step, -step))
        columns.append((ahead - behind) / 2e-6)
    return np.stack(columns, axis=1)


def cloud_term(make: Maker, cloud: int) -> CloudTerm:
    # With normals, the matches would depend on the rotation in a way the gradient ignores.
    term = CloudTerm.between(make(seed=0), make(seed=1), cloud=cloud, normal_weight=0.0)
    return replace(term, metric=np.broadcast_to(np.eye(3), term.metric.shape))


def test_cloud_term_gradient(make_handle: Maker, make_body: Maker) -> None:
    for make, cloud in ((make_handle, PART_CLOUD), (make_body, CONTEXT_CLOUD)):
        dut, state = cloud_term(make, cloud), some_state()
        equations = NormalEquations.zero(len(state))

        dut.linearize(state, 0.3, 1.7, equations)

        expected = 1.7 * numerical_gradient(lambda s, d=dut: d.energy(s, 0.3), state)
        np.testing.assert_allclose(equations.g, expected, atol=1e-6)


def test_cloud_term_of_a_cloud_with_itself_is_zero(make_handle: Maker) -> None:
    cloud = make_handle()
    dut = CloudTerm.between(cloud, cloud, cloud=PART_CLOUD, normal_weight=0.3)

    energy = dut.energy(AlignmentState.start(np.eye(3)[None]), 0.1)

    np.testing.assert_allclose(energy, 0.0, atol=1e-12)


def test_opposite_normals_cost_more(make_body: Maker) -> None:
    cloud = make_body()
    flipped = PointCloud(cloud.points, -cloud.normals)
    same, opposite = (
        CloudTerm.between(cloud, other, cloud=CONTEXT_CLOUD, normal_weight=0.5).energy(
            AlignmentState.start(np.eye(3)[None]), 0.1
        )[0]
        for other in (cloud, flipped)
    )

    assert opposite > same + 0.3


def join_term(make_handle: Maker, make_body: Maker, context: PointCloud) -> JoinTerm | None:
    terms = cloud_term(make_handle, PART_CLOUD), cloud_term(make_body, CONTEXT_CLOUD)
    return JoinTerm.between(*terms, part=make_handle(), context=context)


def test_join_term_gradient(make_handle: Maker, make_body: Maker) -> None:
    dut = join_term(make_handle, make_body, make_body())
    assert dut is not None
    # With equal deviations the result does not depend on the normals' rotation.
    dut = replace(dut, along=dut.across)
    state = some_state()
    equations = NormalEquations.zero(len(state))

    dut.linearize(state, 0.7, equations)

    np.testing.assert_allclose(
        equations.g, 0.7 * numerical_gradient(dut.energy, state), rtol=1e-5, atol=1e-6
    )


def test_no_join_where_part_and_rest_are_apart(make_handle: Maker, make_body: Maker) -> None:
    body = make_body()
    far = PointCloud(body.points - [0.1, 0.0, 0.0], body.normals)

    assert join_term(make_handle, make_body, far) is None


def test_neighbours_agree_with_a_tree_in_both_directions() -> None:
    rng = np.random.default_rng(0)
    sources, target = rng.normal(size=(4, 60, 6)), rng.normal(size=(45, 6))

    (of_sources, source_squares), (of_target, target_squares) = nearest_both_ways(sources, target)

    for k in range(4):
        d, j = cKDTree(target).query(sources[k])
        e, i = cKDTree(sources[k]).query(target)
        np.testing.assert_array_equal(of_sources[k], j)
        np.testing.assert_array_equal(of_target[k], i)
        np.testing.assert_allclose(source_squares[k], d**2)
        np.testing.assert_allclose(target_squares[k], e**2)
