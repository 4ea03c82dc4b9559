"""A recording for other programs: tables, CSV or Parquet, of samples as they came and of results
by kind; or the samples as messages of IMUs.

    FILE.mcap ─┬─► samples-TURBINE-UNIT.csv     time, one column a channel
               ├─► modes.csv  mode_shapes.csv  posterior.csv  figures.csv  pairs.csv  events.csv
               │   rejected.csv  gaps.csv  scada.csv  truth.csv   one row a finding, times UTC
               └─► imu.mcap          every sample a ROS 2 message of its level's IMU

Memory stays flat however long the recording: rows are written as soon as there are enough.
"""
