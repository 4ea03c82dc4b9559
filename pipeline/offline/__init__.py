"""One recording, no run: identify, calibrate, draw, describe, audit."""
