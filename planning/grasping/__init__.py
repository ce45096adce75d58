"""How objects are taken hold of: by fingers, by a suction cup, from which side and how low."""
