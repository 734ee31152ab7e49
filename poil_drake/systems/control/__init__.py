"""Point-set BCSDM, safe entry and the choice of what moves the arm."""
