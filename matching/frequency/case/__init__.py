"""The case of a match: what is asked, read from files, its target modes, and what the vehicle's manoeuvre demands."""
