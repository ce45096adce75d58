"""Where things are and whether they touch: robots, scenes, forward and inverse kinematics, collision. Knows no goal."""
