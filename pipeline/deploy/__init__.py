"""Getting pilewatch onto machines: who they are, what they may say, what starts them.

certificates        a certificate authority of one's own, one certificate a machine (cryptography)
access              who may publish and read which keys; Zenoh configurations that say so

examples/           Zenoh configurations (JSON5, for `--zenoh-config` and for zenohd alike), systemd
                    units and a compose file: one machine, a tower unit with a shore station, a farm
                    behind routers
"""
