"""Test beds that nobody modelled: FMUs over the truth plant's engine. Shares no code with the product."""
