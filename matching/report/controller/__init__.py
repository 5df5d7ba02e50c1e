"""The tuned controller in a report: its blocks with their numbers, |S| and |T|, its distance from instability."""
