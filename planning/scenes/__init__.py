"""Scenes: made at random by a spec, built from words or from a folder of meshes, a cabinet fitted to an arm."""
