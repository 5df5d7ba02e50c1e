"""Commissioning a bed: match, export, run, verify; where it falls short, excite, record, diagnose, match again."""
