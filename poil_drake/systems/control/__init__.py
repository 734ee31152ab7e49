"""Point-set BCSDM, safe entry, and the selection of the arm's motion."""
