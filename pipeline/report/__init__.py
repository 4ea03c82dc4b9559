"""Reports of a session or a file as pages and figures."""
