"""Learned models: their weights, licences and input images."""
