"""One recording, no run: identify, update, draw, describe."""
