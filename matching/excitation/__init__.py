"""Plans the recording that identifies, within the bed's limits, what a match depends on most."""
