"""Grasps of the target, x_g: which may be taken, which are proposed, and those that come from elsewhere."""
