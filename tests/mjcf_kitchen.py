"""A user's own mug, rack and scenario in a folder, as MJCF and YAML."""

import itertools
from pathlib import Path

import numpy as np

RADIUS, HEIGHT, WALL = 0.039, 0.095, 0.004
"""Dimensions of the mug's body [m]."""


def write_kitchen(folder: Path) -> Path:
    """Writes models and scenario into a folder and returns the scenario file."""
    (folder / "mug.xml").write_text(_mug())
    (folder / "rack.xml").write_text(_rack())
    scenario = folder / "kitchen.yaml"
    scenario.write_text(_SCENARIO)
    return scenario


def _mug() -> str:
    sides = 14
    width = 2 * (RADIUS + WALL / 2) * np.tan(np.pi / sides)
    geoms = [
        f'<geom name="mug_wall_{i}" type="box" size="{WALL / 2} {width / 2:.5f} {HEIGHT / 2}" '
        f'pos="{RADIUS * np.cos(a):.5f} {RADIUS * np.sin(a):.5f} {HEIGHT / 2}" '
        f'euler="0 0 {np.degrees(a):.3f}" rgba="{0.9 if i % 2 else 0.15} 0.55 0.2 1" mass="0.012"/>'
        for i, a in enumerate(2 * np.pi * np.arange(sides) / sides)
    ]
    geoms.append(
        f'<geom name="mug_floor" type="cylinder" size="{RADIUS} 0.002" pos="0 0 0.002" '
        'rgba="0.9 0.55 0.2 1" mass="0.03"/>'
    )
    # A handle of straight bars around an opening of 32 mm by 48 mm.
    corners = [(0.0, 0.072), (0.026, 0.078), (0.038, 0.066), (0.038, 0.034), (0.026, 0.022)]
    corners.append((0.0, 0.028))
    for i, (a, b) in enumerate(itertools.pairwise(corners)):
        (x0, z0), (x1, z1) = a, b
        geoms.append(
            f'<geom name="mug_handle_{i}" type="capsule" size="0.0045" mass="0.008" '
            f'fromto="{RADIUS + x0:.5f} 0 {z0} {RADIUS + x1:.5f} 0 {z1}" rgba="0.2 0.2 0.8 1"/>'
        )
    body = "\n      ".join(geoms)
    return f"""<mujoco model="users_mug">
  <worldbody>
    <body name="cup">
      <freejoint/>
      {body}
    </body>
  </worldbody>
</mujoco>
"""


def _rack() -> str:
    tip = [0.0, -0.14 * np.cos(np.radians(15)), 0.26 + 0.14 * np.sin(np.radians(15))]
    return f"""<mujoco model="users_rack">
  <worldbody>
    <body name="stand" pos="0.55 0.30 0">
      <geom name="base" type="box" size="0.08 0.08 0.0075" pos="0 0 0.0075" rgba=".4 .3 .2 1"/>
      <geom name="post" type="cylinder" size="0.011 0.14" pos="0 0 0.14" rgba=".4 .3 .2 1"/>
      <geom name="rod_bar" type="capsule" size="0.0055" rgba=".6 .6 .6 1"
        fromto="0 0 0.26 {tip[0]:.5f} {tip[1]:.5f} {tip[2]:.5f}" friction="0.6 0.005 0.0001"/>
    </body>
  </worldbody>
</mujoco>
"""


_SCENARIO = """
Kitchen:
  directives:
  - add_model:
      name: table
      file: package://poil_drake/fixtures/table.sdf
  - add_weld:
      parent: world
      child: table::table
  - add_model:
      name: rack
      file: rack.xml
  - add_model:
      name: panda
      file: package://poil_drake_panda/panda.urdf
  - add_weld:
      parent: world
      child: panda::panda_link0
      X_PC:
        translation: [-0.04, 0.03, 0.0]
        rotation: !Rpy { deg: [0, 0, 8] }
  - add_model:
      name: mug
      file: mug.xml
      default_free_body_pose:
        cup:
          translation: [0.46, -0.10, 0.001]
          rotation: !Rpy { deg: [0, 0, 60] }
  initial_position:
    panda:
      panda_joint1: [0.0]
      panda_joint2: [-0.9]
      panda_joint3: [0.0]
      panda_joint4: [-2.5]
      panda_joint5: [0.0]
      panda_joint6: [1.6]
      panda_joint7: [0.785398]
      panda_finger_joint1: [0.04]
      panda_finger_joint2: [0.04]
  cameras:
    left: &camera
      name: left
      width: 640
      height: 480
      focal: !FovDegrees { y: 55 }
      z_near: 0.1
      z_far: 3.0
      renderer_name: vtk
      renderer_class: !RenderEngineVtkParams { backend: EGL }
      X_PB:
        translation: [0.80, 0.70, 0.62]
        rotation: !Rpy { deg: [-118, 0, 154.18] }
    right:
      <<: *camera
      name: right
      X_PB:
        translation: [0.80, -0.55, 0.62]
        rotation: !Rpy { deg: [-118, 0, 25.46] }
  poil:
    object: mug
    part: handle
    parts: { handle: "mug_handle_.*" }
    demonstration_object: mug.xml
    demonstration_motion: { hanging: { rod: "rod_.*" } }
"""
