"""The search for causes: candidates are fitted one after another until the residual is noise."""
