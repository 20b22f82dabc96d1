"""Filters and their honesty, for any 6-component state: no sensor is known here."""
