"""Files: scenes and plans as JSON Lines, every value checked."""
