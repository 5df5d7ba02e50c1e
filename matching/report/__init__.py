"""What a reader gets: figures and pages."""
