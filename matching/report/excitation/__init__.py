"""How a planned excitation is drawn and written."""
