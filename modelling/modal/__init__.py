"""Modes of a drivetrain: undamped and damped, symmetry, sensitivities, tracking, values reduced to one shaft."""
