"""What the windows have shown: observed modes and their sums over the windows."""
