"""Error statistics and published figures: what was reached, beside what was claimed."""
