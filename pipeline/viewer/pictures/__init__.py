"""The contents of pictures, computed without Rerun."""
