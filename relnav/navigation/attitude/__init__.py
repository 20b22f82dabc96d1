"""The target's attitude and rate from measured attitudes, without its position."""
