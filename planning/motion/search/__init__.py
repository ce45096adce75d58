"""From configuration to configuration, compiled: certified edges, RRT-Connect, shortcuts, straight reaches."""
