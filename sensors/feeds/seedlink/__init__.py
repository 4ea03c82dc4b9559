"""SeedLink: data loggers and servers of seismology, versions 3 and 4."""
