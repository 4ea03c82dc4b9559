"""Getting pilewatch onto machines: who they are, what they may publish, what starts them.

certificates        a certificate authority of one's own, one certificate a machine (cryptography)
access              who may publish and read which keys; Zenoh configurations that enforce it

examples/           Zenoh configurations (JSON5, for `--zenoh-config` and for zenohd alike), systemd
                    units and a compose file: one machine, a tower unit with a shore station, a farm
                    behind routers
"""
