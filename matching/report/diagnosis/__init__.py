"""Views of a diagnosis: figures, page, sentences."""
