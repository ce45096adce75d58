"""Picking and placing: which ways there are to take hold of an object, to carry it and to put it down."""
