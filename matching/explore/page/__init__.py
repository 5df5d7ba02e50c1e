"""The page of `rigmatch explore`: Panel and Bokeh, as little as possible; everything else is in the room above."""
