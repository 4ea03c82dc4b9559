"""Export a recording for other programs, as tables (CSV, Parquet) or as messages of IMUs.

    FILE.mcap ─┬─► samples-TURBINE-UNIT.csv     time, one column a channel
               ├─► modes.csv  mode_shapes.csv  posterior.csv  figures.csv  pairs.csv  events.csv
               │   rejected.csv  gaps.csv  scada.csv  truth.csv   one row per result, times UTC
               └─► imu.mcap          every sample a ROS 2 message of its level's IMU

Memory stays flat however long the recording: rows are written as soon as there are enough.
"""
