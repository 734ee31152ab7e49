import numpy as np
import pytest
from labelled_frames import exact_masks

from poil_drake.diagrams.demonstration.recorder import MakeDemonstrationMotion
from poil_drake.diagrams.demonstration.scene import DemonstrationScene
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.geometry.point_cloud import farthest_point_sampling
from poil_drake.geometry.rigid_transform import inverse, transform_points
from poil_drake.perception.fusion import fuse_views
from poil_drake.perception.trackers.rigid_flow.tracker import RigidFlowTracker


@pytest.mark.render
def test_tracks_the_handle_through_the_built_in_demonstration():
    scenario = ChooseScenario()
    scene = DemonstrationScene(scenario)
    motion = MakeDemonstrationMotion(scene, scenario.poil.demonstration_motion)
    # At the end a rod of the mug's colour goes through the handle.
    times = np.arange(0.0, motion.duration, 1 / 8)
    scene.put_object(motion.pose(0.0))
    first = scene.capture(0.0, labels=True)
    seen = exact_masks(first)
    cloud = fuse_views(first, seen.part_masks).points
    points = cloud[farthest_point_sampling(cloud, 10)]
    dut = RigidFlowTracker()
    output = dut.start(first, points, seen.object_masks)

    errors, confidences = [], []
    for time in times[1:].tolist():
        scene.put_object(motion.pose(time))
        output = dut.step(output.state, scene.capture(time, labels=False))
        truth = transform_points(motion.pose(time) @ inverse(motion.pose(0.0)), points)
        assert not output.lost
        errors.append(np.linalg.norm(output.points.positions - truth, axis=1))
        confidences.append(output.points.confidence.mean())

    # The tracker's goals.
    assert np.median(errors) < 3e-3
    assert np.percentile(errors, 95) < 10e-3
    assert np.max(errors) < 15e-3
    assert np.median(confidences[-8:]) > 0.5
