"""What a picture shows, computed without Rerun."""
