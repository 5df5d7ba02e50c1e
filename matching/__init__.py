"""Matching, judging and diagnosing: what is done with drivetrain models."""
