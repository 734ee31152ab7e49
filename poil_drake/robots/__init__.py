"""The Panda: data, kinematics, IK, shape, limits; no pydrake. Drivers: `systems.lcm`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
