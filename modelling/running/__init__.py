"""Plants and controllers in time: what a row is, what sensors make of it, and the one loop that steps rows."""
