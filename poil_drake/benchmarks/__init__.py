"""The studies and measurements of `poil bench`. Each writes its results as JSON."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
