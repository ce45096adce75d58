"""Plans as files that a controller takes: ROS 2, URScript, Franka's rows, CSV, NumPy."""
