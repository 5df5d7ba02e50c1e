"""Recordings in the browser: which column is which channel, decimation, measured responses."""
