"""Blocks → windows: which ones are used, alignment of the units and windowing."""
