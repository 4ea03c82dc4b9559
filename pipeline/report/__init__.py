"""Pages and figures to send: what a session or a file said, for people."""
