"""Blocks → windows: alignment of the units and windowing."""
