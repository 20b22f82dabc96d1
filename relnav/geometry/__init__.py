"""Pure geometry of vectors, frames and angles: no sensor, no filter, no file."""
