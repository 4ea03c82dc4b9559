"""How nodes are run: runner, snapshots, restart, flow control, supervisor."""
