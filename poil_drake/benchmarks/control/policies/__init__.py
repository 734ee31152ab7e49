"""The policies that the control study compares."""
