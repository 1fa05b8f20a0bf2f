"""Variable-rate shading: rates, what shading at one would look like, its error, tile by tile."""
