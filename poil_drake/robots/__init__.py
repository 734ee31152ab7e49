"""The Panda's kinematics, IK, shape and limits, without pydrake; drivers are in `systems.lcm`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
