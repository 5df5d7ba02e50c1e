from match_verification.conftest import feedback, reference

__all__ = ["feedback", "reference"]  # fixtures
