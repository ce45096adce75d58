"""Compiling what every plan needs, before it is called."""
