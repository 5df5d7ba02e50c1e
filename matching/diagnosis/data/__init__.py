"""From recordings to the data of a fit: segments without gaps, noise by sensor, what is fitted and what is held out."""
