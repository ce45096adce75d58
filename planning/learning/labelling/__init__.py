"""Labels: which states are labelled, what the arm can do in them, and the folder of shards that they fill."""
