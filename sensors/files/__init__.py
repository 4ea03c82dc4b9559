"""One reader a format, all giving `ChannelTable`s."""
