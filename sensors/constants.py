"""Numbers that several rooms need, each with its unit."""

STANDARD_GRAVITY = 9.80665  # [m/s²], by definition (CGPM 1901)
DAY = 86_400  # [s]
LOOPBACK = "127.0.0.1"  # this machine alone
HIGHEST_PORT = 65_535  # of TCP and UDP
