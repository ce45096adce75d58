"""Depth images of solids and meshes, the synthetic camera, shaded stills."""
