"""The project's fuzzer: changed inputs of every kind, each answered or refused in one line."""
