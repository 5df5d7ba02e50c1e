"""What every figure, page and text shares: colours, numbers and units in words, tables, page templates."""
