"""Views of an uncertainty budget: contributions, Ishikawa diagram, table."""
