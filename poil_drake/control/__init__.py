"""References, the Point-set BCSDM field, its stability theory and safe entry, without pydrake."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
