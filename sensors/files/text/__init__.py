"""Text files of measurements: dialect, preamble, column titles, dates and the columns' values."""
