"""Finished motions, played again: FCL's word on them, and how far they keep from everything."""
