"""How long a control tick takes."""
