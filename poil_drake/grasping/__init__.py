"""Grasp candidates, grasp rehearsal, motions to a grasp, and execution plans, without pydrake."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
