"""The mug family: the parameters that describe a mug, and the mugs that the package ships."""

from dataclasses import dataclass
from typing import Literal

from poil_drake.errors import InvalidValueError

HandleShape = Literal["c", "d", "square", "ear"]
"""Handle outlines: half circle, flat-sided half circle, rounded square, ear (wider at the top)."""

Texture = Literal["plain", "stripes", "dots", "checks", "noise", "logo"]
"""Surface decorations. "plain" has one colour, so a tracker sees only the outline."""

ROD_CLEARANCE = (0.026, 0.040)
"""Smallest opening of a handle, radial and vertical [m], through which an 11 mm rod fits easily."""


@dataclass(frozen=True, kw_only=True)
class MugParameters:
    """One mug. Its frame is at the centre of the underside; +z is up, and the handle is along +x.

    Attributes:
        name: File and model name.
        radius: Outer radius of the body at the rim [m].
        taper: Ratio of the outer radius at the bottom to that at the rim.
        height: Height of the body [m].
        wall: Thickness of the wall [m]; it must fit between the gripper's fingers.
        handle_shape: Outline of the handle.
        handle_clearance: Radial opening between the body and the inside of the handle [m].
        handle_opening: Opening of the handle along the mug's axis [m].
        handle_height: Height of the handle's centre above the underside [m].
        handle_radius: Half the thickness of the handle's tube [m].
        texture: Surface decoration.
        color: Base colour, RGB in [0, 1].
        accent: Colour of the decoration, RGB in [0, 1].
        seed: Seed of the decoration.
        mass: Mass of body and handle together [kg].
    """

    name: str
    radius: float = 0.040
    taper: float = 0.95
    height: float = 0.095
    wall: float = 0.0035
    handle_shape: HandleShape = "c"
    handle_clearance: float = 0.029
    handle_opening: float = 0.048
    handle_height: float = 0.052
    handle_radius: float = 0.0045
    texture: Texture = "plain"
    color: tuple[float, float, float] = (0.85, 0.85, 0.82)
    accent: tuple[float, float, float] = (0.15, 0.25, 0.55)
    seed: int = 0
    mass: float = 0.30

    def __post_init__(self) -> None:
        for name, low, high in (
            ("radius", 0.032, 0.045),
            ("taper", 0.75, 1.1),
            ("height", 0.075, 0.110),
            ("wall", 0.003, 0.004),
            ("handle_clearance", ROD_CLEARANCE[0], 0.05),
            ("handle_opening", ROD_CLEARANCE[1], 0.08),
            ("handle_radius", 0.0035, 0.005),
            ("mass", 0.1, 0.6),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise InvalidValueError(
                    f"Mug '{self.name}' has {name} = {value:g}, which is out of range.",
                    remedy=f"Use a value between {low:g} and {high:g}.",
                )
        half = self.handle_opening / 2 + 2 * self.handle_radius
        if not half <= self.handle_height <= self.height - half:
            raise InvalidValueError(
                f"The handle of mug '{self.name}', {2 * half:.3f} m tall and centred at "
                f"{self.handle_height:.3f} m, does not fit on a body of {self.height:.3f} m.",
                remedy="Reduce handle_opening, or change handle_height.",
            )


NAMED_MUGS: tuple[MugParameters, ...] = (
    MugParameters(
        name="mug_demo", texture="checks", color=(0.88, 0.86, 0.80), accent=(0.60, 0.20, 0.15)
    ),
    MugParameters(
        name="mug_a", radius=0.044, taper=1.0, height=0.105, handle_shape="d",
        handle_clearance=0.031, handle_opening=0.058, handle_height=0.058,
        texture="stripes", color=(0.80, 0.84, 0.88), accent=(0.10, 0.25, 0.55), mass=0.34,
    ),
    MugParameters(
        name="mug_b", radius=0.036, taper=0.90, height=0.083, handle_shape="square",
        handle_clearance=0.027, handle_opening=0.042, handle_height=0.046, handle_radius=0.004,
        texture="plain", color=(0.20, 0.45, 0.38), mass=0.26,
    ),
    MugParameters(
        name="mug_c", radius=0.041, taper=0.97, height=0.090, handle_shape="ear",
        handle_clearance=0.034, handle_opening=0.050, handle_height=0.050, handle_radius=0.0048,
        texture="noise", color=(0.75, 0.62, 0.45), accent=(0.35, 0.20, 0.12), seed=3, mass=0.31,
    ),
    MugParameters(
        name="mug_d", radius=0.033, taper=1.0, height=0.110, handle_shape="c",
        handle_clearance=0.030, handle_opening=0.054, handle_height=0.064, handle_radius=0.004,
        texture="dots", color=(0.90, 0.78, 0.35), accent=(0.15, 0.15, 0.18), seed=5, mass=0.27,
    ),
    MugParameters(
        name="mug_e", radius=0.045, taper=0.87, height=0.078, handle_shape="c",
        handle_clearance=0.028, handle_opening=0.041, handle_height=0.042,
        texture="logo", color=(0.86, 0.84, 0.84), accent=(0.55, 0.10, 0.30), seed=7, mass=0.30,
    ),
    MugParameters(
        name="mug_f", radius=0.039, taper=1.0, height=0.098, handle_shape="square",
        handle_clearance=0.036, handle_opening=0.060, handle_height=0.052, handle_radius=0.005,
        texture="plain", color=(0.72, 0.30, 0.22), mass=0.33,
    ),
    MugParameters(
        name="mug_g", radius=0.037, taper=0.93, height=0.100, handle_shape="ear",
        handle_clearance=0.032, handle_opening=0.056, handle_height=0.056, handle_radius=0.0042,
        texture="checks", color=(0.30, 0.50, 0.70), accent=(0.90, 0.90, 0.85), mass=0.28,
    ),
)  # fmt: skip
"""The shipped mugs. The built-in demonstration shows `mug_demo`; the others are for transfer."""
