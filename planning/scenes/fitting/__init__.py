"""Where a cabinet stands best for an arm, how large it is, and what stands in it."""
