"""What to do: problems, grasps, motions, policies, and the retrieval loop that joins them."""
