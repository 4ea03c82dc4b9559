"""Where the pictures go: a file, a viewer, a page; each with its drawing thread."""
