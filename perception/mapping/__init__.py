"""What is known of the cabinet's space: voxels, what a depth image adds, which view to take next."""
