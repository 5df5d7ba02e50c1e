"""Models and controllers as FMUs."""
