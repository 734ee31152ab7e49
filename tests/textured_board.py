"""The scenario with a calibration board in the robot's hand, seen by its rendered cameras."""

from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from poil_drake.diagrams.scenario.load import LoadScenario, default_scenario_file
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station import MakeStation
from poil_drake.geometry.rigid_transform import inverse, make_transform
from poil_drake.perception.calibration.board import CalibrationBoard
from poil_drake.perception.calibration.view_folder import View, save_view
from poil_drake.perception.images import CameraModel
from poil_drake.robots.panda_kinematics import PandaModel

BOARD = CalibrationBoard()
HOME = np.array([0.0, -0.6, 0.0, -2.4, 0.0, 1.8, 0.785])

_MARGIN = 0.01  # [m]
_SDF = """<sdf version="1.9"><model name="board"><link name="board">
<inertial><mass>0.1</mass></inertial>
<visual name="board"><geometry><mesh><uri>board.obj</uri></mesh></geometry></visual>
</link></model></sdf>
"""
_OBJ = """mtllib board.mtl
v {x0} {y0} 0
v {x1} {y0} 0
v {x1} {y1} 0
v {x0} {y1} 0
vt 0 1
vt 1 1
vt 1 0
vt 0 0
vn 0 0 -1
usemtl board
f 1/1/1 4/4/1 3/3/1 2/2/1
"""
_MTL = "newmtl board\nKa 1 1 1\nKd 1 1 1\nmap_Kd board.png\n"


def write_board(folder: Path) -> Path:
    """Writes a model of the board, whose frame is that of `CalibrationBoard`."""
    folder.mkdir(parents=True, exist_ok=True)
    width, height = BOARD.save(folder / "board.png")
    # Twice the camera's resolution: VTK does not average over fine texture.
    image = cv2.imread(str(folder / "board.png"))
    smaller = cv2.resize(image, (1144, 840), interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(folder / "board.png"), smaller)
    corners = {"x0": -_MARGIN, "x1": width - _MARGIN, "y0": -_MARGIN, "y1": height - _MARGIN}
    (folder / "board.obj").write_text(_OBJ.format(**corners))
    (folder / "board.mtl").write_text(_MTL)
    (folder / "board.sdf").write_text(_SDF)
    return folder / "board.sdf"


def pose_on_hand() -> np.ndarray:
    """Returns X_GB, with which the board faces the cameras at HOME."""
    R = Rotation.from_euler("xyz", [180.0, 40.0, 0.0], degrees=True).as_matrix()
    R = R @ Rotation.from_euler("z", 90.0, degrees=True).as_matrix()
    centre = np.array([0.5, 0.0, 0.25])
    X_WB = make_transform(R, centre - R @ BOARD.corners.mean(axis=0))
    return inverse(PandaModel().gripper_pose(HOME)) @ X_WB


def board_scenario(board_sdf: Path) -> Scenario:
    """Returns the package's scenario with the board in the hand."""
    plain = LoadScenario(filename=default_scenario_file())
    X = pose_on_hand()
    rpy = Rotation.from_matrix(X[:3, :3]).as_euler("xyz", degrees=True).tolist()
    text = default_scenario_file().read_text()
    directives = text[text.index("  directives:") : text.index("  initial_position:")]
    directives += f"""  - add_model:
      name: board
      file: file://{board_sdf}
  - add_weld:
      parent: panda::panda_hand_tcp
      child: board::board
      X_PC: {{ translation: {X[:3, 3].tolist()}, rotation: !Rpy {{ deg: {rpy} }} }}
"""
    return LoadScenario(defaults=plain, data=directives)


def postures(count: int, *, seed: int = 0) -> np.ndarray:
    """Returns postures (count, 7) of the arm around HOME [rad]."""
    rng = np.random.default_rng(seed)
    spread = [0.15, 0.12, 0.15, 0.12, 0.3, 0.25, 0.6]
    return HOME + rng.uniform(-1.0, 1.0, size=(count, 7)) * spread


def render_views(scenario: Scenario, folder: Path, q: np.ndarray) -> tuple[CameraModel, ...]:
    """Saves noisy, blurred images of the arm in postures (V, 7); returns the cameras."""
    station = MakeStation(scenario, ignore_output_delay=True)
    context = station.CreateDefaultContext()
    plant = station.plant()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    arm = plant.GetModelInstanceByName("panda")
    rng = np.random.default_rng(0)
    for number, posture in enumerate(q):
        plant.SetPositions(plant_context, arm, [*posture, 0.01, 0.01])
        images = {}
        for name, image in zip(station.camera_names, station.TakeImages(context), strict=True):
            blurred = cv2.GaussianBlur(image.rgb, (0, 0), 0.7)
            noisy = blurred + rng.normal(scale=4.0, size=blurred.shape)
            images[name] = np.clip(noisy, 0, 255).astype(np.uint8)
        save_view(folder, View(f"{number:02d}", images, posture))
    return station.camera_models
