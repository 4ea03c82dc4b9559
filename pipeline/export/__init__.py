"""A recording as tables for other programs, CSV or Parquet: samples as they came, results by kind.

    FILE.mcap ─┬─► samples-TURBINE-UNIT.csv     time, one column a channel
               └─► modes.csv  mode_shapes.csv  posterior.csv  pairs.csv  events.csv  rejected.csv
                   gaps.csv  scada.csv  truth.csv     one row a finding, times UTC

Memory stays flat however long the recording: rows are written as soon as there are enough.
"""
