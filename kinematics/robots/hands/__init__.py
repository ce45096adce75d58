"""What an arm holds with: the gripper is found in the tree of joints, and what its fingers leave free is measured."""
