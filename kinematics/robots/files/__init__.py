"""URDF files as they are found, made fit for every reader: cleaned, joined, their joints and meshes checked."""
