"""What is wrong with the logs of an alignment, found and named: before the filter runs, and from what it found."""
