"""Training of the networks on a folder of labels, and how good they are on states that they have not seen."""
