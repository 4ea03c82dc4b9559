"""Turbines alike, each lending the others what it knows: `pilewatch farm`."""
