"""Looking around with the camera in the hand, and the retrieval loop without the truth."""
