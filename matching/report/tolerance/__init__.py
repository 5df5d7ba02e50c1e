"""Views of a tolerance study: distributions and their drivers."""
