"""Views of models and modes: energy shares, mode table, moving drawing, equations."""
