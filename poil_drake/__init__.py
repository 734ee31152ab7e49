"""Point-based one-shot imitation learning with stable dynamical systems, in Drake.

`import poil_drake as poil` gives access to the public names. Each is loaded on its first use.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
