"""Sphere covers: balls that provably contain a solid, coarse and fine, made once."""
