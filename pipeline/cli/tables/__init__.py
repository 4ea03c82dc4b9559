"""What the commands print for people: rich tables."""
