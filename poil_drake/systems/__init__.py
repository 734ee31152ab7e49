"""Drake LeafSystems, which give the package's pure functions ports, state and events."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
