"""The controller as it runs on the bed, in Python and in C."""
