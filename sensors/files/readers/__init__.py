"""One reader a file format: arrays and records → SEP005 channels, tables → ChannelTables."""
