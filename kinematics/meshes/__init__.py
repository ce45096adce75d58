"""Meshes as scans are, in: convex parts that provably contain them, out."""
