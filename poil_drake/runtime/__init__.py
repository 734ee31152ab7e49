"""Processes, threads, clocks, signals, scheduling and files, independent of what runs on them."""
