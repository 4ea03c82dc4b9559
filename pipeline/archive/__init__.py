"""Years of recordings again, in parallel: `pilewatch reprocess`."""
