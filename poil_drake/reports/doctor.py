"""Checks whether this machine has what poil_drake needs."""

import importlib
import importlib.metadata
import platform
import sys
from collections.abc import Callable

from poil_drake.errors import PoilError
from poil_drake.reports.finding import Finding
from poil_drake.reports.model_doctor import model_findings, tracker_findings


def Examine() -> list[Finding]:
    """Checks Python, libraries, rendering, LCM and learned models, in that order."""
    pip = f"{sys.executable} -m pip install"
    multicast = "ip link set lo multicast on && ip route add 224.0.0.0/4 dev lo"
    checks: list[tuple[str, Callable[[], str], str]] = [
        ("python", platform.python_version, "make setup PYTHON=python3.12"),
        ("drake", lambda: _version("drake", "pydrake"), f"{pip} drake"),
        ("robot", _robot, f"{pip} example-robot-data"),
        ("pinocchio", lambda: _version("pin", "pinocchio"), f"{pip} pin"),
        ("ompl", lambda: _version("ompl", "ompl.geometric"), f"{pip} ompl"),
        ("open3d", lambda: _version("open3d", "open3d"), f"{pip} open3d"),
        ("torch", _torch, f"{pip} torch"),
        ("rendering", _rendering, _apt("libegl1", "libgl1", "libgl1-mesa-dri")),
        ("lcm", _lcm, f"Only for hardware: sudo sh -c '{multicast}'"),
    ]
    findings = [_finding(name, check, remedy) for name, check, remedy in checks]
    return [*findings, *model_findings(), *tracker_findings()]


def _apt(*packages: str) -> str:
    return f"sudo apt-get install {' '.join(packages)}"


# System libraries that Python packages load: library -> Debian and Ubuntu package.
_LIBRARIES = {
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libEGL.so.1": "libegl1",
    "libGL.so.1": "libgl1",
    "libgomp.so.1": "libgomp1",
}


def _finding(name: str, check: Callable[[], str], remedy: str) -> Finding:
    try:
        return Finding(name, True, check(), remedy)
    except (ImportError, RuntimeError, OSError, PoilError) as error:
        found = str(error).splitlines()[0]
        missing = [_apt(package) for library, package in _LIBRARIES.items() if library in found]
        return Finding(name, False, found, missing[0] if missing else remedy)


def _version(distribution: str, module: str) -> str:
    importlib.import_module(module)
    return importlib.metadata.version(distribution)


def _robot() -> str:
    from poil_drake.robots.robot_description import panda_description_directory

    panda_description_directory()
    return f"Panda of example-robot-data {importlib.metadata.version('example-robot-data')}"


def _torch() -> str:
    import torch

    device = torch.cuda.get_device_name() if torch.cuda.is_available() else "CPU"
    return f"{torch.__version__} on {device}"


def _rendering() -> str:
    from pydrake.geometry import MakeRenderEngineVtk, RenderEngineVtkParams, SceneGraph
    from pydrake.math import RigidTransform
    from pydrake.systems.sensors import CameraConfig

    scene_graph = SceneGraph()
    scene_graph.AddRenderer("vtk", MakeRenderEngineVtk(RenderEngineVtkParams(backend="EGL")))
    camera, _ = CameraConfig(width=64, height=48, renderer_name="vtk").MakeCameras()
    query = scene_graph.get_query_output_port().Eval(scene_graph.CreateDefaultContext())
    image = query.RenderColorImage(camera, scene_graph.world_frame_id(), RigidTransform())
    return f"VTK on EGL drew {image.width()} x {image.height()} pixels"


def _lcm() -> str:
    from pydrake.lcm import DrakeLcm

    url = "udpm://239.255.76.67:7667?ttl=0"
    lcm = DrakeLcm(url)
    received: list[bytes] = []
    lcm.Subscribe("POIL_DOCTOR", received.append)
    for _ in range(10):
        lcm.Publish("POIL_DOCTOR", b"hello")
        if lcm.HandleSubscriptions(100):
            return f"multicast on {url}"
    raise RuntimeError(f"no message came back on {url}")
