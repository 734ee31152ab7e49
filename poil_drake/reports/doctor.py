"""Checks that this machine has everything that poil_drake needs."""

import importlib
import importlib.metadata
import platform
from collections.abc import Callable
from dataclasses import dataclass

from poil_drake.errors import PoilError


@dataclass(frozen=True)
class Finding:
    """The outcome of one check.

    Attributes:
        name: What was checked.
        ok: Whether it works.
        found: Its version or state, or the error.
        remedy: What to do if it does not work.
    """

    name: str
    ok: bool
    found: str
    remedy: str


def Examine() -> list[Finding]:
    """Checks Python, libraries, rendering, LCM and the torch device, in that order."""
    checks: list[tuple[str, Callable[[], str], str]] = [
        ("python", platform.python_version, "Use Python 3.11 or newer."),
        ("drake", lambda: _version("drake", "pydrake"), "Run `make setup`."),
        ("robot", _robot, "Run `make setup`; the Panda comes with example-robot-data."),
        ("pinocchio", lambda: _version("pin", "pinocchio"), "Run `make setup`."),
        ("ompl", lambda: _version("ompl", "ompl.geometric"), "Run `make setup`."),
        ("open3d", lambda: _version("open3d", "open3d"), "Install Debian's libusb-1.0-0."),
        ("torch", _torch, "Run `make setup`."),
        ("rendering", _rendering, "Install Debian's libegl1 and libgl1-mesa-dri."),
        ("lcm", _lcm, "Allow UDP multicast on loopback; only hardware stations need it."),
    ]
    return [_finding(name, check, remedy) for name, check, remedy in checks]


def _finding(name: str, check: Callable[[], str], remedy: str) -> Finding:
    try:
        return Finding(name, True, check(), remedy)
    except (ImportError, RuntimeError, OSError, PoilError) as error:
        return Finding(name, False, str(error).splitlines()[0], remedy)


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
    from pydrake.geometry import (
        ClippingRange,
        ColorRenderCamera,
        MakeRenderEngineVtk,
        RenderCameraCore,
        RenderEngineVtkParams,
        SceneGraph,
    )
    from pydrake.math import RigidTransform
    from pydrake.systems.sensors import CameraInfo

    scene_graph = SceneGraph()
    scene_graph.AddRenderer("vtk", MakeRenderEngineVtk(RenderEngineVtkParams(backend="EGL")))
    core = RenderCameraCore(
        "vtk", CameraInfo(64, 48, 0.8), ClippingRange(0.01, 10.0), RigidTransform()
    )
    context = scene_graph.CreateDefaultContext()
    image = (
        scene_graph.get_query_output_port()
        .Eval(context)
        .RenderColorImage(ColorRenderCamera(core), scene_graph.world_frame_id(), RigidTransform())
    )
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
