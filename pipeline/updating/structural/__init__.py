"""Springs and the structure's uncertain figures inferred together."""
