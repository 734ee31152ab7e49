"""Point-based one-shot imitation learning with stable dynamical systems, in Drake.

The names that users type, each loaded when it is first used: `import poil_drake as poil`.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
