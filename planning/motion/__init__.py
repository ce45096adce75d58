"""Motions: compiled RRT-Connect, shortcutting, pick-and-place, time stamps, and the exact check of the result."""
