"""Point-based one-shot imitation learning with stable dynamical systems, in Drake."""

__version__ = "0.1.0"
