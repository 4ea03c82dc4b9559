"""What is wrong, what is known: summary, status, metrics and alarms of a run."""
