"""Pictures of a report that need more than frequencies and stiffness over time."""
