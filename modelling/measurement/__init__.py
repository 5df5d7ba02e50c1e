"""Measured data: files of several formats become recordings in SI on one time base."""
