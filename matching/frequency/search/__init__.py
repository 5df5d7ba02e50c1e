"""From a case to a match: released quantities, the search, its verification, and what stands in the way."""
