"""What is learned: labels of states, the two networks, their training, and the folder that a model lives in."""
