"""Where an archive's files lie: on this machine's disks, or behind a URL."""
