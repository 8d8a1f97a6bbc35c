"""Searches with the runs of studies: for gains that bear the worst, and for what breaks them."""
