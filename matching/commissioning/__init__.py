"""The whole way onto the bed: excite, record, diagnose, match with what was found, export, run, verify."""
