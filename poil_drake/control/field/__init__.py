"""The Point-set BCSDM field and its rollouts (POIL, section III-B)."""
