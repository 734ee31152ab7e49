"""Simulates a demonstration: the object moves as if by a hand, and the cameras record."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from poil_drake.diagrams.demonstration.hanging_motion import hanging_keyframes
from poil_drake.diagrams.demonstration.motion import KeyframeMotion
from poil_drake.diagrams.demonstration.scene import DemonstrationScene
from poil_drake.diagrams.scenario.demonstration_config import DemonstrationMotionConfig
from poil_drake.diagrams.scenario.dump import DumpScenario
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import ScenarioError
from poil_drake.recording.demonstration.writer import DemonstrationWriter

Progress = Callable[[str, float], None]


def RecordDemonstration(
    scenario: Scenario,
    path: str | Path,
    *,
    metadata: Mapping[str, str] | None = None,
    progress: Progress | None = None,
) -> int:
    """Records the scenario's built-in demonstration.

    The scenario's `demonstration_object` moves by itself, without a robot in view, and the cameras
    take pictures at the tracker's rate, with the sensors' noise. The first frame carries render
    labels, so that detectors that read them work on it. The file holds the whole scenario, too.

    Args:
        scenario: The scenario.
        path: The MCAP file to write; it appears only when the recording is complete.
        metadata: What else to say in the file.
        progress: Told what is done and which share of it, in [0, 1].

    Returns:
        The number of frames.

    Raises:
        ScenarioError: when the scenario has no cameras, or its demonstration cannot be made.
    """
    if not scenario.cameras:
        raise ScenarioError(
            "The scenario has no cameras, so nothing can be recorded.",
            remedy="Name at least one under 'cameras'.",
        )
    scene = DemonstrationScene(scenario)
    motion = MakeDemonstrationMotion(scene, scenario.poil.demonstration_motion)
    period = scenario.poil.rates.tracker
    times = period * np.arange(int(motion.duration / period) + 1)
    said = {
        "scenario": scenario.source.name,
        "scenario_file": scenario.source.file,
        "object": Path(scenario.poil.demonstration_object).stem,
        "fixture": scenario.poil.fixture,
        "part": scenario.poil.part,
        "seed": str(scenario.random_seed),
        **(metadata or {}),
    }
    text = DumpScenario(scenario)
    with DemonstrationWriter(path, scene.camera_names, said, scenario_text=text) as writer:
        for i, time in enumerate(times.tolist()):
            scene.put_object(motion.pose(time))
            writer.write(scene.capture(time, labels=i == 0))
            if progress is not None:
                progress("recording the demonstration", (i + 1) / len(times))
    return len(times)


def MakeDemonstrationMotion(
    scene: DemonstrationScene, config: DemonstrationMotionConfig
) -> KeyframeMotion:
    """Returns the object's motion: through the keyframes given, or hung on the fixture's rod.

    Raises:
        ScenarioError: when the keyframes make no motion, or the object cannot be hung.
    """
    if config.keyframes:
        times = np.array([keyframe.time for keyframe in config.keyframes])
        poses = np.array([keyframe.pose for keyframe in config.keyframes])
    else:
        times, poses = hanging_keyframes(scene, config.hanging)
    return KeyframeMotion(times, poses, blend=config.blend)
