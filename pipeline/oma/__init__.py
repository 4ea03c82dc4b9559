"""Identification of modes from accelerations: output-only, it never sees the structure."""
