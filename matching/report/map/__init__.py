"""Views of a map: contours or fields of the response error, hatched by what limits the match."""
