"""A URDF in, a robot out: cleaned files, the tree of joints, limits, grippers, forward kinematics."""
