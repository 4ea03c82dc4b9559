"""What a run listens to: a recording, a simulation, feeds, files."""
