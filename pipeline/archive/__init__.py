"""Years of recordings anew, in parallel: `pilewatch reprocess`."""
