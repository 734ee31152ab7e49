"""Geometry on NumPy arrays: rigid transforms, point clouds and depth images. No pydrake."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
