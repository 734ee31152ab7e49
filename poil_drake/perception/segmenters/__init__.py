"""Segmenters, which turn boxes into masks, and share one protocol."""
