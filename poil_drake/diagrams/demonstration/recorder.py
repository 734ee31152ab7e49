"""Simulates a demonstration: the object moves as if held by a hand, and the cameras record it."""

from pathlib import Path

import numpy as np

from poil_drake.diagrams.demonstration.checks import CheckMotion, CheckView
from poil_drake.diagrams.demonstration.hanging_motion import hanging_keyframes
from poil_drake.diagrams.demonstration.motion import KeyframeMotion
from poil_drake.diagrams.demonstration.scene import DemonstrationScene
from poil_drake.diagrams.scenario.demonstration_config import DemonstrationMotionConfig
from poil_drake.diagrams.scenario.load import DumpScenario
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import ScenarioError
from poil_drake.perception.detectors.registry import LABEL_IMAGE
from poil_drake.recording.demonstration.writer import DemonstrationWriter
from poil_drake.transfer.progress import Progress


def RecordDemonstration(
    scenario: Scenario, path: str | Path, *, progress: Progress | None = None
) -> int:
    """Records the scenario's built-in demonstration.

    The scenario's `demonstration_object` moves without a robot, and the cameras capture images at
    the tracker's rate, with the sensors' noise. The first frame has label images if the detector
    reads them. The file also holds the whole scenario.

    Args:
        scenario: The scenario.
        path: The MCAP file to write; it appears when the recording is complete.
        progress: Called with the activity and its completed fraction in [0, 1].

    Returns:
        The number of frames.

    Raises:
        ScenarioError: The scenario has no cameras, or its demonstration cannot be simulated or
            shows too little of the part.
    """
    if not scenario.cameras:
        raise ScenarioError(
            "The scenario has no cameras, so nothing can be recorded.",
            remedy="Define at least one under 'cameras'.",
        )
    scene = DemonstrationScene(scenario)
    motion = MakeDemonstrationMotion(scene, scenario.poil.demonstration_motion)
    period = scenario.poil.rates.tracker
    times = period * np.arange(int(motion.duration / period) + 1)
    CheckMotion(scene, motion, times, scenario.poil)
    contents = {
        "scenario": scenario.source.name,
        "scenario_file": scenario.source.file,
        "object": Path(scenario.poil.demonstration_object).stem,
        "fixture": scenario.poil.fixture,
        "part": scenario.poil.part,
        "seed": str(scenario.random_seed),
    }
    text = DumpScenario(scenario)
    labels = scenario.poil.detector == LABEL_IMAGE
    with DemonstrationWriter(path, scene.camera_names, contents, scenario_text=text) as writer:
        for i, time in enumerate(times.tolist()):
            scene.put_object(motion.pose(time))
            frame = scene.capture(time, labels=labels and i == 0)
            if labels and i == 0:
                CheckView(frame, scenario.poil)
            writer.write(frame)
            if progress is not None:
                progress("recording the demonstration", (i + 1) / len(times))
    return len(times)


def MakeDemonstrationMotion(
    scene: DemonstrationScene, config: DemonstrationMotionConfig
) -> KeyframeMotion:
    """Returns the object's motion: through the configured keyframes, or onto the fixture's rod.

    Raises:
        ScenarioError: The object cannot be hung on the rod.
    """
    if config.keyframes:
        times = np.array([keyframe.time for keyframe in config.keyframes])
        poses = np.array([keyframe.pose for keyframe in config.keyframes])
    else:
        times, poses = hanging_keyframes(scene, config.hanging)
    return KeyframeMotion(times, poses, blend=config.blend)
