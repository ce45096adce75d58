"""One robot before one cabinet, packed for compiled code, and asked in names."""
