"""Channel samples put together by time → blocks of a second."""
