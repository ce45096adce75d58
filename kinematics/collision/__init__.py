"""Whether things touch: sphere covers and the compiled check, GJK along edges, FCL's exact word."""
