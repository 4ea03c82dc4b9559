"""One turbine's history, day by day: passes that continue from a checkpoint, months as Parquet."""
