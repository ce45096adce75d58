"""Pages and stills of scenes and plans."""
