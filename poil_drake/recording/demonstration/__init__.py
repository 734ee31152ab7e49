"""Demonstration files."""
