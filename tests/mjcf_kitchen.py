"""A user's own mug, rack and scenario in a folder, as MJCF and YAML."""

from pathlib import Path

import numpy as np
from bare_mugs import write_bare_mug


def write_kitchen(folder: Path) -> Path:
    """Writes models and scenario into a folder and returns the scenario file."""
    write_bare_mug(folder, shapes="boxes", height=0.095)
    (folder / "rack.xml").write_text(_rack())
    scenario = folder / "kitchen.yaml"
    scenario.write_text(_SCENARIO)
    return scenario


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
    parts: { handle: "handle_.*" }
    demonstration_object: mug.xml
    demonstration_motion: { hanging: { rod: "rod_.*" } }
"""
