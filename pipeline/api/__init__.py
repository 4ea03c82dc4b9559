"""The library's public face; installed as the top-level package `pilewatch`."""
