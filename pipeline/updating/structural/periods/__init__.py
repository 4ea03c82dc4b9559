"""Several periods of one structure: common figures, springs of their own."""
