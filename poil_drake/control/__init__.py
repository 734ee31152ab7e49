"""References, the Point-set BCSDM field, its stability theory and safe entry, without pydrake."""
