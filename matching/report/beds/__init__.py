"""Drawn beds under an observer in the report of a match: requirements, held or missed, and the spread of errors."""
