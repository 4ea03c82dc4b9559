"""Is the measurement fit to be identified: inputs, blocks, clocks, machines."""
