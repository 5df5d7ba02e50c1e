"""Views of a match: figures, page, text."""
