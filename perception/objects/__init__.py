"""Pixels to boxes: instances told apart, solids fitted, footprints."""
