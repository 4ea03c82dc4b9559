"""What is measured, on what, by which instruments. Pure: no transport, no recording, no viewer.

Whatever the source (simulated, replayed, read from a file, live), what comes out is always
`AccelerationBlock`s. `pipeline` starts the sources, so there is no `python -m sensors`.
"""
