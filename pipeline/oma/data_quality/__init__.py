"""Is the measurement fit to be identified: inputs, blocks, swapped channels, clocks."""
