"""Drivetrain models: what a drivetrain is and does."""
