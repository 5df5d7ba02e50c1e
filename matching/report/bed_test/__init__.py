"""How the verification of a bed is drawn and written."""
