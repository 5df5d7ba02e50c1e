"""A drivetrain as data: components, quantities, effects, checks, and the model file they are read from."""
