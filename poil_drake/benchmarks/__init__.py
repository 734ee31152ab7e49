"""Published studies and measurements; each prints a table and writes JSON."""
