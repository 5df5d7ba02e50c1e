"""Elements of the page that hold nothing but what they show."""
