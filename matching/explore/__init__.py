"""What `rigmatch explore` does, without its page: files that are edited, models that follow, commands that run."""
