"""A long campaign of made faults, diagnosed and scored."""
