"""The same filter as users of other packages write it."""
