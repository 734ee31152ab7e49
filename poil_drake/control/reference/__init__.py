"""The references that the field follows, made from tracked points."""
