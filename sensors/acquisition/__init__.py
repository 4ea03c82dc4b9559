"""What instruments send: blocks of samples, layouts, SCADA, pacing and resampling."""
