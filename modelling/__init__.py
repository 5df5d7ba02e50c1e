"""Drivetrain models: what a drivetrain is and does."""

DISTRIBUTION = "rigmatch"  # by which rigmatch.py notices another distribution's package of the same name
