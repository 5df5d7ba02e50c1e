"""Diagnosis of a model against recordings: what it lacks, where, how surely, and the extended model."""
