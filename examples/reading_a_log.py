"""Reads the log of a run: python examples/reading_a_log.py out/run.mcap."""

import sys

import numpy as np

from poil_drake.recording import load_recorded_run

run = load_recorded_run(sys.argv[1])
print(f"{run.end:.1f} s, logged by poil_drake {run.metadata['poil_drake_version']}")
for phase in run.phases:
    print(f"{phase.time:6.2f} s: {phase.name}")
fastest = np.abs(run.commands.values).max(axis=0)
print("fastest commands [rad/s]:", np.round(fastest, 2))
ages = [track.time - track.track.stamp for track in run.tracks]
print(f"{len(ages)} tracks, {1000 * np.median(ages):.0f} ms old when they were logged (median)")
for camera, images in run.images.items():
    print(f"camera '{camera}': {len(images)} images")
