"""What an image says to a filter: rows, noise, lasting errors, poses to start from, what monitors look at."""
