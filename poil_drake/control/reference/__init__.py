"""From tracked points to the reference that the field follows."""
