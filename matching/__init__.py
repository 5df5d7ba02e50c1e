"""Matching, judging and diagnosing: what is done with drivetrain models."""

__version__ = "0.1.0"
